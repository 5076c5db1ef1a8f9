"""Tests of the ways in which MetaTask applies a task: after the reset, and to a wrapper."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.classic_control import PendulumEnv
from gymnasium.spaces import Box
from gymnasium.wrappers import TransformReward

from sb3_bruno_envs import MetaTask, PointDirEnv, TransitionObservation, Trial, check_meta_env

GOALS = [[0.2], [0.5], [0.9]]


class OwnGoalEnv(gym.Env):
    """Draws its goal in ``reset``, as FetchReach does; the observation is the position and, if ``shows``, the goal."""

    action_space = Box(-1.0, 1.0, (1,))

    def __init__(self, shows=False):
        self.shows = shows
        self.observation_space = Box(-10.0, 10.0, (2 if shows else 1,))
        self.goal = self.x = 0.0

    def observe(self):
        return np.array([self.x, self.goal][: 1 + self.shows], np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.goal = 0.1 * self.np_random.standard_normal(2)
        return self.observe(), {}

    def step(self, action):
        self.x += 0.1 * float(action[0])
        return self.observe(), -abs(self.x - self.goal), False, False, {}


class OwnContext(gym.Wrapper):
    """Chooses a context at every reset and writes it into the environment, as CARL's wrappers do."""

    def reset(self, *, seed=None, options=None):
        self.context = {"g": 10.0}
        self._update_context()
        return self.env.reset(seed=seed, options=options)

    def _update_context(self):
        for name, value in self.context.items():
            setattr(self.env.unwrapped, name, value)


class Goal(gym.Wrapper):
    """Keeps a goal of its own and rewards by it."""

    goal = 0.0

    def step(self, action):
        observation, _, *rest = self.env.step(action)
        return observation, -abs(float(observation[0]) - self.goal), *rest


def set_goal(env, task):
    env.goal = float(task[0])


def set_and_show_goal(env, task):
    env.goal = float(task[0])
    return env.observe()


def set_context(env, task):
    env.set_wrapper_attr("context", {**env.get_wrapper_attr("context"), "g": float(task[0])})
    env.get_wrapper_attr("_update_context")()


def set_wrappers_goal(env, task):
    env.set_wrapper_attr("goal", float(task[0]))


def own_goal(apply_task=set_goal, **kwargs):
    return MetaTask(OwnGoalEnv(kwargs.pop("shows", False)), apply_task, GOALS, when="after_reset", **kwargs)


def own_context():
    return MetaTask(
        gym.wrappers.TimeLimit(OwnContext(PendulumEnv()), 20), set_context, GOALS, when="after_reset", unwrap=False
    )


def wrapped_goal():  # of the class TimeLimit that there is now: rl_zoo3 replaces it, and a pickle must find it
    return MetaTask(gym.wrappers.TimeLimit(Goal(PointDirEnv()), 20), set_wrappers_goal, GOALS, unwrap=False)


def reward_at_rest(env, goal):
    _, _ = env.reset(seed=0, options={"task": [goal]})
    return env.step(np.zeros(env.action_space.shape))[1]


@pytest.mark.parametrize("make", [own_goal, own_context, wrapped_goal])
def test_the_task_is_in_force_where_reset_or_a_wrapper_would_lose_it(make):
    check_meta_env(TransitionObservation(make()))


def test_the_goal_of_the_reset_is_replaced():
    env = own_goal()
    x = float(env.reset(seed=0)[0][0])
    assert reward_at_rest(env, 0.9) == pytest.approx(-abs(x - 0.9), abs=1e-6)
    assert env.unwrapped.goal == np.float32(0.9)


def test_a_stale_first_observation_is_replaced_by_what_apply_task_returns():
    stale, _ = own_goal(shows=True).reset(seed=0, options={"task": [0.9]})
    shown, info = own_goal(set_and_show_goal, shows=True).reset(seed=0, options={"task": [0.9]})
    assert stale[0] == shown[0] and stale[1] != np.float32(0.9) and shown[1] == np.float32(0.9)
    assert info["task"] == np.float32(0.9)


@pytest.mark.parametrize("wrong", [lambda env, task: env, lambda env, task: 3.0, lambda env, task: np.zeros(5)])
def test_what_is_returned_must_be_an_observation(wrong):
    with pytest.raises(ValueError, match=r"apply_task returned .*, no observation of .*: return the first observation"):
        own_goal(wrong).reset(seed=0)


def test_what_is_returned_before_the_reset_is_ignored():
    env = MetaTask(OwnGoalEnv(), lambda env, task: 3.0, GOALS)
    assert env.reset(seed=0)[0].shape == (1,)


def test_the_task_is_applied_again_when_a_trial_resets():
    inner = gym.wrappers.TimeLimit(OwnGoalEnv(shows=True), 3)
    env = MetaTask(Trial(inner, 3), set_and_show_goal, GOALS, when="after_reset")
    env.reset(seed=0, options={"task": [0.9]})
    for _ in range(8):
        assert env.step(np.zeros(1))[0][1] == np.float32(0.9)
        assert env.unwrapped.goal == np.float32(0.9)


class Reporting(gym.Wrapper):
    """Reports where each step led, by a key that is no trial's."""

    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, {**info, "final_observation": observation}


def test_the_task_is_not_applied_again_in_mid_episode_for_a_foreign_key():
    got = []
    env = MetaTask(Reporting(OwnGoalEnv()), lambda env, task: got.append(task), GOALS, when="after_reset")
    env.reset(seed=0)
    env.step(np.zeros(1))
    assert len(got) == 1


def test_apply_task_gets_the_wrappers_on_demand_and_the_bare_environment_else():
    got = []
    inner = TransformReward(PointDirEnv(), abs)
    for unwrap in (False, True):
        MetaTask(inner, lambda env, task: got.append(env), GOALS, unwrap=unwrap).reset()
    assert got == [inner, inner.unwrapped]


def test_a_wrapper_that_keeps_the_task_is_reached():
    env = wrapped_goal()
    assert reward_at_rest(env, 0.9) != reward_at_rest(env, 0.2)


@pytest.mark.parametrize("make", [own_goal, wrapped_goal])
def test_copies_apply_the_task_alike(make):
    env = make()
    env.reset(seed=0)
    copy = pickle.loads(pickle.dumps(env))
    assert reward_at_rest(copy, 0.5) == reward_at_rest(env, 0.5)
    assert env._saved_kwargs["when"] == env._when and env._saved_kwargs["unwrap"] == env._unwrap


def test_an_unknown_moment_is_refused():
    with pytest.raises(ValueError, match="when='later' is unknown: use 'before_reset' or 'after_reset'"):
        MetaTask(OwnGoalEnv(), set_goal, GOALS, when="later")


def test_a_meta_task_inside_is_refused():
    with pytest.raises(ValueError, match="has a MetaTask, which would overwrite the task: wrap what is inside of it"):
        MetaTask(gym.wrappers.TimeLimit(own_goal(), 5), set_goal, GOALS)


@pytest.mark.parametrize("wrong", [3, "set_goal"])
def test_apply_task_must_be_a_function(wrong):
    with pytest.raises(ValueError, match=f"apply_task={wrong!r} is no function"):
        MetaTask(OwnGoalEnv(), wrong, GOALS)
