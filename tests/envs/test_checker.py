"""Tests of the checker: it accepts what keeps the contract, and names each way to break it."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit, TransformAction, TransformReward

from sb3_bruno_envs import MetaTask, PointDirEnv, TaskObservation, TransitionObservation, Trial, check_meta_env
from support.broken_envs import (
    DIRECTIONS,
    Edit,
    SeededAlike,
    Shown,
    Spaces,
    Stubborn,
    Telltale,
    Unseeded,
    at_end,
    drop,
    endless,
    good,
    meta_point,
    mid_episode,
    physics_shown,
    put,
    seeded_alike,
)

NORTH = np.float32([0.0, 1.0])

BROKEN = {
    "no dict": (lambda: meta_point(), "no Dict: wrap the environment in TransitionObservation"),
    "the oracle": (lambda: TaskObservation(meta_point()), r"contains task\[1\], a leak"),
    "no task space": (lambda: TransitionObservation(PointDirEnv()), "no task_space: wrap it in MetaTask"),
    "key missing": (lambda: Spaces(reward=None), "no key 'reward'"),
    "key unknown": (lambda: Spaces(goal=Box(0.0, 1.0, (1,))), "unknown key 'goal'"),
    "action shape": (lambda: Spaces(action=Box(-1.0, 1.0, (3,))), r"\['action'\] is .*make it"),
    "action bounds": (lambda: Spaces(action=Box(-2.0, 2.0, (2,))), r"\['action'\] is .*make it"),
    "reward bounded": (lambda: Spaces(reward=Box(0.0, 1.0, (1,))), r"\['reward'\] is .*make it"),
    "start unbounded": (
        lambda: Spaces(episode_start=Box(-1.0, 1.0, (1,))),
        r"\['episode_start'\] is .*make it",
    ),
    "float64": (
        lambda: Spaces(observation=Box(-1.0, 1.0, (2,), dtype=np.float64)),
        r"\['observation'\] is .*make it a float32 Box",
    ),
    "actions unbounded": (lambda: Spaces(action_space=Box(-np.inf, np.inf, (2,))), "Box with finite bounds"),
    "actions discrete": (lambda: gym.make("CartPole-v1"), "Box with finite bounds"),
    "task space square": (
        lambda: Spaces(task_space=Box(0.0, 1.0, (2, 1))),
        r"task_space is .*shape \(dim,\)",
    ),
    "task space small": (
        lambda: Spaces(task_space=Box(5.0, 6.0, (2,))),
        r"info\['task'\] is .*make it float32",
    ),
    "task float64": (lambda: Edit(put("task", np.array([0.0, 1.0]))), "make it float32"),
    "no task": (lambda: Edit(drop("task")), "info has no 'task'"),
    "no index": (lambda: Edit(drop("task_index")), "info has no 'task_index'"),
    "task changes": (
        lambda: Edit(put("task", NORTH, mid_episode)),
        "after step 1, .*keep it to the last step",
    ),
    "next task at the end": (
        lambda: Edit(put("task", NORTH, at_end)),
        "step 20, the episode's last, .*keep it",
    ),
    "outside its space": (lambda: Edit(put("observation", np.zeros(5, np.float32))), "is outside its space"),
    "action at reset": (
        lambda: Edit(put("action", np.ones(2, np.float32))),
        r"after the reset, .*\['action'\]",
    ),
    "action stale": (lambda: Edit(put("action", np.zeros(2, np.float32))), r"after step 1, .*\['action'\]"),
    "reward stale": (lambda: Edit(put("reward", np.zeros(1, np.float32))), r"after step 1, .*\['reward'\]"),
    "always starting": (
        lambda: Edit(put("episode_start", np.ones(1, np.float32))),
        r"step 1, .*\['episode_start'\]",
    ),
    "never starting": (
        lambda: Edit(put("episode_start", np.zeros(1, np.float32))),
        r"reset, .*\['episode_start'\]",
    ),
    "action changed above": (
        lambda: TransformAction(good(), lambda a: -a, None),
        r"\['action'\] is .*above any wrapper",
    ),
    "reward changed above": (
        lambda: TransformReward(good(), lambda r: r + 1),
        r"\['reward'\] is .*above any wrapper",
    ),
    "options ignored": (lambda: Stubborn(good()), "obey the option"),
    "seed ignored": (lambda: Unseeded(good()), "two different first observations"),
    "task unseeded": (lambda: Unseeded(endless()), r"seed=0 gave the task .* generator that the reset seeds"),
    "task drawn alike": (
        lambda: seeded_alike(lambda rng: rng.standard_normal(2), PointDirEnv()),
        r"tells task\[0\] \(correlation 1.00\)",
    ),
    "finite task drawn alike": (
        lambda: seeded_alike(lambda rng: [float(rng.random() < 0.5)], gym.make("Pendulum-v1")),
        r"tells task\[0\] \(correlation -0.\d+\), a leak",
    ),
    "task shown": (lambda: TransitionObservation(Telltale(meta_point())), r"contains task\[0\], a leak"),
}


def test_a_good_environment_passes():
    check_meta_env(good())
    check_meta_env(TransitionObservation(meta_point()), max_steps=50)  # never ends


@pytest.mark.parametrize("name", BROKEN)
def test_each_way_to_break_the_contract_is_named(name):
    build, message = BROKEN[name]
    with pytest.raises(ValueError, match=message):
        check_meta_env(build())


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("key", ["reward", "observation"])
def test_what_is_not_finite_is_the_one_finding(key, value):
    env = TransformReward(PointDirEnv(), lambda reward: value) if key == "reward" else Shown(value)
    env = MetaTask(env, PointDirEnv.set_task, DIRECTIONS)
    with pytest.raises(ValueError, match=rf"\['{key}'\] is \[.*{value}.*\], not finite: bound it, or end") as found:
        check_meta_env(TimeLimit(TransitionObservation(env), 20))
    problems = str(found.value).splitlines()[1:]
    assert all("not finite" in problem for problem in problems) and "instead of" not in str(found.value)


def test_physics_that_show_the_task_in_the_first_observation_are_a_warning():
    with pytest.warns(UserWarning, match=r"first observation tells task\[0\] \(correlation .*\), and not by the seed"):
        check_meta_env(physics_shown())


def test_a_task_drawn_as_the_environment_draws_is_an_error_though_physics_show_it_too():
    class Alike(SeededAlike):
        def __init__(self, env, apply_task, tasks):
            space = Box(0.0, 20.0, (1,))
            super().__init__(env, apply_task, lambda rng: [5.0 + 10.0 * rng.random()], task_space=space)

    with pytest.raises(ValueError, match=r"first observation tells task\[0\] .*generator spawned from the seed"):
        check_meta_env(physics_shown(Alike))


def test_a_scaled_copy_of_the_task_is_a_warning_that_tells_to_take_it_out():
    class Scaled(Telltale):
        def observation(self, observation):
            return np.concatenate([observation, 0.1 * self.get_wrapper_attr("task")])

    with pytest.warns(UserWarning, match=r"\(correlation 1.00\), .*made from the task, take it out"):
        check_meta_env(TransitionObservation(Scaled(meta_point())))


def test_one_message_lists_everything_that_is_wrong():
    env = Stubborn(Edit(put("reward", np.float32([7.0])), Spaces(episode_start=Box(-1.0, 1.0, (1,)))))
    with pytest.raises(ValueError, match=r"(?s)'episode_start'.*reset, .*'reward'.*step 1, .*'reward'.*option"):
        check_meta_env(env)


def test_an_environment_that_raises_is_a_finding_beside_others():
    def fail(observation, info, step):
        if step == 3:
            raise RuntimeError("battery empty")

    with pytest.raises(ValueError, match=r"(?s)no key 'reward'.*an episode raised RuntimeError\('battery empty'\)"):
        check_meta_env(Edit(fail, Spaces(reward=None)))


def test_an_inner_episode_of_a_trial_may_start_in_mid_trial():
    def restart(observation, info, step):
        if step == 10:
            info["trial_final_observation"] = observation["observation"].copy()
            observation["episode_start"][:] = 0.5
            observation["action"][:] = observation["reward"][:] = 0.0

    check_meta_env(Edit(restart))


def test_an_inner_episode_that_does_not_say_that_it_starts_is_found_out():
    def restart(observation, info, step):
        if step == 10:
            info["trial_final_observation"] = observation["observation"].copy()

    with pytest.raises(ValueError, match=r"step 10, .*\['episode_start'\] is \[0.\] instead of \[0.5\]"):
        check_meta_env(Edit(restart))


@pytest.mark.parametrize(("inner", "n_episodes", "told"), [(1, 4, 1), (1, 1, 1), (2, 2, 0)])
def test_episodes_in_which_nothing_is_inferred_are_a_warning(inner, n_episodes, told, recwarn):
    trial = Trial(TimeLimit(PointDirEnv(), inner), n_episodes)
    check_meta_env(TransitionObservation(MetaTask(trial, lambda env, task: env.unwrapped.set_task(task), DIRECTIONS)))
    assert sum("ended after one step" in str(warning.message) for warning in recwarn) == told


@pytest.mark.parametrize("wrong", [None, "sb3_bruno_envs:PointDir-v0"])
def test_what_is_no_environment_is_told_in_one_line(wrong):
    with pytest.raises(ValueError, match=f"env={wrong!r} is no Gymnasium environment: give one"):
        check_meta_env(wrong)
