"""Tests of hide_goal on a small goal environment."""

import pickle
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, flatdim

from sb3_bruno_envs import (
    MetaTask,
    TaskObservation,
    TaskSampler,
    TaskSet,
    TransitionObservation,
    Trial,
    check_meta_env,
    goal_tasks,
    hide_goal,
)


class Reach(gym.Env):
    """Moves a point in the plane to a goal, in the form that all goal environments have."""

    action_space = Box(-1.0, 1.0, (2,))
    goals = Box(-2.0, 2.0, (2,), np.float64)

    def __init__(self, resets_target=False):
        self.resets_target = resets_target
        places = Box(-20.0, 20.0, (2,), np.float64)
        self.observation_space = Dict(observation=places, achieved_goal=places, desired_goal=self.goals)
        self.goal = np.zeros(2)

    def observe(self):
        return {"observation": self.x / 2, "achieved_goal": self.x.copy(), "desired_goal": self.goal}

    def draw_goal(self):
        return self.np_random.uniform(-1, 1, 2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = 0.1 * self.np_random.standard_normal(2)
        self.goal = self.draw_goal()
        return self.observe(), {}

    def step(self, action):
        self.x = self.x + 0.1 * np.asarray(action, np.float64)
        reward = self.compute_reward(self.x, self.goal, {})
        info = {"is_success": reward > -0.1}
        if self.resets_target:
            self.goal = self.draw_goal()
        return self.observe(), reward, False, False, info

    def compute_reward(self, achieved_goal, desired_goal, info):
        return -float(np.linalg.norm(achieved_goal - desired_goal))


class FewGoals(Reach):
    """Draws one of three goals."""

    def draw_goal(self):
        return np.full(2, self.np_random.integers(3) / 2)


class GoalElsewhere(gym.Wrapper):
    """Keeps the goal where no attribute ``goal`` is."""

    unwrapped = property(lambda self: SimpleNamespace(keeper=self.env))


def reach(**kwargs):
    return gym.wrappers.TimeLimit(Reach(), 20, **kwargs)


def test_the_goal_is_hidden_and_is_the_task():
    env = hide_goal(reach())
    check_meta_env(TransitionObservation(env))
    observation, info = env.reset(seed=3)
    assert observation.keys() == env.observation_space.keys() == {"achieved_goal", "observation"}
    assert env.observation_space.contains(observation)
    np.testing.assert_array_equal(env.unwrapped.goal, info["task"])
    assert env.unwrapped.goal.dtype == np.float64


def test_the_oracle_sees_the_task():
    env = TaskObservation(hide_goal(reach()))
    observation, info = env.reset(seed=0)
    np.testing.assert_array_equal(observation[-2:], info["task"])


def test_the_reward_is_that_of_the_tasks_goal():
    env = hide_goal(reach())
    env.reset(seed=0)
    observation, reward, *_, info = env.step(np.ones(2))
    assert reward == env.unwrapped.compute_reward(observation["achieved_goal"], np.float64(info["task"]), info)


def test_tasks_are_the_goals_of_resets_with_fixed_seeds_and_no_test_goal_is_trained_on():
    tasks = goal_tasks(reach(), 30, 10)
    for split, first_seed, n in (("train", 0, 30), ("test", 1_000_000, 10)):
        drawn = [reach().reset(seed=first_seed + i)[0]["desired_goal"] for i in range(n)]
        np.testing.assert_array_equal(tasks.tasks(split), np.float32(drawn))
    both = np.concatenate([tasks.tasks("train"), tasks.tasks("test")])
    assert len(np.unique(both, axis=0)) == 40
    env = hide_goal(reach())
    assert env.task_distribution == hide_goal(reach(), goal_tasks(reach())).task_distribution


@pytest.mark.parametrize("n", [(3, 1), (4, 1), (2, 2)])
def test_more_goals_than_there_are_is_refused(n):
    with pytest.raises(ValueError, match=rf"n_train={n[0]} and n_test={n[1]} are too many: .* different goals"):
        goal_tasks(FewGoals(), *n)


@pytest.mark.parametrize("n", [(0, 1), (1, 0), (-3, 2)])
def test_goals_of_a_split_are_at_least_one(n):
    with pytest.raises(ValueError, match=r"n_(train|test)=\S+ is not a positive integer: give at least 1"):
        goal_tasks(FewGoals(), *n)


def test_few_goals_are_split_without_overlap():
    tasks = goal_tasks(FewGoals(), 2, 1)
    assert {float(task[0]) for task in [*tasks.tasks("train"), *tasks.tasks("test")]} == {0.0, 0.5, 1.0}


def test_drawing_tasks_leaves_unseeded_episodes_random():
    firsts = []
    for _ in range(2):
        env = reach()
        goal_tasks(env, 2, 2)
        firsts.append(env.reset()[0]["observation"])
    assert not np.array_equal(*firsts)


def test_split_and_draw_are_those_of_meta_task():
    env = hide_goal(reach(), TaskSet([[0.0, 0.0]], [[0.5, 0.5], [1.0, 0.5]]), split="test", draw="cycle")
    assert [env.reset()[1]["task"][0] for _ in range(3)] == [0.5, 1.0, 0.5]


def test_a_trial_keeps_its_goal():
    env = TransitionObservation(hide_goal(Trial(gym.wrappers.TimeLimit(Reach(), 5), 3)))
    check_meta_env(env)
    _, info = env.reset(seed=0, options={"task": goal_tasks(reach()).tasks()[7]})
    task = info["task"]
    for _ in range(14):
        *_, info = env.step(np.ones(2))
        np.testing.assert_array_equal(env.unwrapped.goal, task)
        assert "desired_goal" not in info.get("trial_final_observation", {})


def test_a_goal_that_changes_in_mid_episode_is_refused():
    env = hide_goal(Reach(resets_target=True), [[0.5, 0.5], [1.0, 1.0]])
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"the goal is .*, the task .*: .*reset_target=False"):
        env.step(np.ones(2))


def test_a_goal_under_another_name_is_set_by_a_function():
    env = hide_goal(GoalElsewhere(Reach()))
    with pytest.raises(ValueError, match=r"has no attribute goal: pass set_goal\(env.unwrapped, goal\)"):
        env.reset(seed=0)
    env = hide_goal(GoalElsewhere(Reach()), set_goal=lambda bare, goal: setattr(bare.keeper, "goal", goal))
    check_meta_env(TransitionObservation(env))


def test_a_function_that_sets_nothing_is_found():
    env = hide_goal(Reach(), set_goal=lambda env, goal: None)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="let set_goal set the goal"):
        env.step(np.ones(2))


@pytest.mark.parametrize(
    "space", [Box(-1, 1, (2,)), Dict(observation=Box(-1, 1, (2,))), Dict(desired_goal=Discrete(3))]
)
def test_an_environment_without_a_goal_is_refused(space):
    env = Reach()
    env.observation_space = space
    for make in (hide_goal, goal_tasks):
        with pytest.raises(ValueError, match=r"has no goal to hide: .*, or set the task by MetaTask"):
            make(env)


def test_a_goal_of_many_parts_is_one_vector():
    class Parts(Reach):
        goals = Dict(to=Box(-2.0, 2.0, (2,), np.float64))

        def observe(self):
            return {**super().observe(), "desired_goal": {"to": self.goal}}

    env = hide_goal(Parts(), [[0.25, 0.5], [1.0, 1.0]], set_goal=lambda env, goal: setattr(env, "goal", goal["to"]))
    _, info = env.reset(seed=0)
    env.step(np.ones(2))
    np.testing.assert_array_equal(env.unwrapped.goal, info["task"])


def test_a_copy_goes_on_with_the_goal():
    env = hide_goal(reach())
    env.reset(seed=0)
    copy = pickle.loads(pickle.dumps(env))
    assert isinstance(copy, MetaTask) and copy.step(np.ones(2))[1] == env.step(np.ones(2))[1]


class Spaced(Reach):
    """Shows a goal of zeros, in a given space."""

    def __init__(self, space):
        super().__init__()
        self.observation_space = Dict(observation=Box(-20.0, 20.0, (2,)), desired_goal=space)


def box(*shape):
    return Box(-2.0, 2.0, shape, np.float64)


@pytest.mark.parametrize(
    ("space", "name"),
    [
        (box(1), "goal (0.5)"),
        (box(3), "goal (0.5, 0.5, 0.5)"),
        (box(8), f"goal ({', '.join(['0.5'] * 8)})"),
        (box(9), None),
        (box(2, 2), None),
        (Dict(to=box(2)), None),
    ],
)
def test_goals_that_are_short_vectors_have_names_and_those_in_space_entries(space, name):
    dim = flatdim(space)
    env = hide_goal(Spaced(space), np.full((1, dim), 0.5))
    assert env.name_of(np.full(dim, 0.5, np.float32)) == name
    entries = (("goal x", ""), ("goal y", ""), ("goal z", ""))[:dim] if space.shape and len(space.shape) == 1 else None
    assert env.task_entries == (entries if dim <= 3 else None)


def test_goals_get_names_and_entries_of_ones_own():
    entries = (("east", "m"), ("north", "m"))
    env = hide_goal(reach(), [[0.5, 1.0]], name_task=lambda goal: f"{goal[0]:g} east", task_entries=entries)
    assert env.task_entries == entries and env.reset(seed=0)[1]["task_name"] == "0.5 east"
    assert hide_goal(reach(), [[0.5, 1.0]]).reset(seed=0)[1]["task_name"] == "goal (0.5, 1)"


@pytest.mark.parametrize(
    "tasks", [[[1.0]], TaskSet([[1.0, 2.0, 3.0]]), TaskSampler(lambda rng: [0.0], Box(-1, 1, (1,)))]
)
def test_tasks_of_another_size_than_goals_are_refused_at_once(tasks):
    with pytest.raises(ValueError, match=r"tasks=.* hold [13] numbers each, .*desired_goal.* holds 2: give .*\(n, 2\)"):
        hide_goal(reach(), tasks)


@pytest.mark.parametrize(
    ("told", "is_success"),
    [
        ({"success": True}, True),
        ({"success": 0.0}, 0.0),
        ({"success": True, "is_success": False}, False),
        ({"is_success": True}, True),
        ({}, None),
    ],
)
def test_a_success_under_another_name_counts(told, is_success):
    class Telling(Reach):
        def step(self, action):
            return *super().step(action)[:4], told

    for env in (Telling(), Trial(gym.wrappers.TimeLimit(Telling(), 1), 2)):
        env = TransitionObservation(hide_goal(env, [[0.5, 0.5]]))
        env.reset(seed=0)
        for _ in range(2 if isinstance(env.env.env.env, Trial) else 1):
            assert env.step(np.ones(2))[4].get("is_success") == is_success
