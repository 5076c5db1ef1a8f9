"""Tests that a task which is not in force is found: one that does nothing, compounds, or is overwritten."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.classic_control import PendulumEnv
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv
from gymnasium.spaces import Box
from gymnasium.wrappers import NormalizeReward, TimeLimit

from sb3_bruno_envs import MetaTask, PointDirEnv, TaskObservation, TransitionObservation, Trial, check_meta_env
from sb3_bruno_envs.task_effect import find_task_without_effect

pytestmark = pytest.mark.filterwarnings("error:.*made no difference")
NO_EFFECT = r"made no difference to 5 episodes of up to 200 steps: let apply_task write, for every task, what"
COMPOUNDS = r"the task .* gave another episode when it came again, .*: let apply_task write all"
FACTORS = [[0.5], [1.0], [2.0]]

pendulum = pytest.param(PendulumEnv, "g", id="pendulum")
hopper = pytest.param(lambda: HopperEnv(), "hopper", id="hopper", marks=pytest.mark.mujoco)
point = pytest.param(lambda: PointOfStrength(), "strength", id="point")
every_env = pytest.mark.parametrize(("make", "name"), [pendulum, hopper, point])


class PointOfStrength(PointDirEnv):
    """A point whose actions have a hidden strength."""

    strength = 1.0

    def step(self, action):
        return super().step(self.strength * np.asarray(action))


class Overwriting(gym.Wrapper):
    """Writes the parameter in its reset, as an environment that draws a goal or a context there."""

    def __init__(self, env, name):
        super().__init__(env)
        self.name = name

    def reset(self, **kwargs):
        write(self.env.unwrapped, self.name, 1.0)
        return self.env.reset(**kwargs)


class OwnParameter(gym.Wrapper):
    """Rewards by an attribute of its own."""

    weight = 1.0

    def step(self, action):
        observation, reward, *rest = self.env.step(action)
        return observation, self.weight * reward, *rest


class FarReward(gym.Env):
    """Pays 1 beyond a hidden wall, which random actions reach late, if ever."""

    action_space = Box(-1.0, 1.0, (1,))
    observation_space = Box(-100.0, 100.0, (1,))
    wall = 5.0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = 0.0
        return np.array([self.x], np.float32), {}

    def step(self, action):
        self.x += 0.3 * float(action[0])
        return np.array([self.x], np.float32), float(self.x > self.wall), False, False, {}


def write(env, name, factor):
    """Set a parameter to a factor of what it is at first."""
    if name == "hopper":
        first = vars(env).setdefault("first_gear", env.model.actuator_gear.copy())
        env.model.actuator_gear[:] = factor * first
    else:
        setattr(env, name, factor * getattr(type(env)(), name))


def scale(env, name, factor):
    """Multiply a parameter, whatever it is now."""
    if name == "hopper":
        env.model.actuator_gear[:] *= factor
    else:
        setattr(env, name, factor * getattr(env, name))


def meta(env, apply_task, tasks=FACTORS, **kwargs):
    return TransitionObservation(MetaTask(TimeLimit(env, 40), apply_task, tasks, **kwargs))


def assert_found(env, message):
    with pytest.raises(ValueError, match=message):
        check_meta_env(env)


@every_env
def test_a_task_in_force_passes(make, name):
    check_meta_env(meta(make(), lambda env, task: write(env, name, task[0])))


@every_env
def test_a_function_that_does_nothing_is_found(make, name):
    assert_found(meta(make(), lambda env, task: None), NO_EFFECT)


@every_env
def test_a_misspelt_attribute_is_found(make, name):
    assert_found(meta(make(), lambda env, task: setattr(env, "gravty", task[0])), NO_EFFECT)


@every_env
def test_a_change_relative_to_the_last_task_is_found(make, name):
    assert_found(meta(make(), lambda env, task: scale(env, name, task[0])), COMPOUNDS)


@every_env
def test_factors_whose_product_is_one_compound_too(make, name):
    assert_found(meta(make(), lambda env, task: scale(env, name, task[0]), [[0.5], [2.0]]), COMPOUNDS)


@every_env
def test_a_task_that_stays_behind_is_found(make, name):
    def only_above_one(env, task):
        if task[0] > 1.0:
            write(env, name, task[0])

    assert_found(meta(make(), only_above_one), f"{COMPOUNDS}|{NO_EFFECT}")  # by whether it has come before


@every_env
def test_a_reset_that_overwrites_the_task_is_found_and_the_remedy_helps(make, name):
    def apply_task(env, task):
        write(env, name, task[0])

    assert_found(meta(Overwriting(make(), name), apply_task), f"{NO_EFFECT}.*when='after_reset'")
    check_meta_env(meta(Overwriting(make(), name), apply_task, when="after_reset"))


@every_env
def test_an_attribute_that_a_wrapper_keeps_is_found_and_the_remedy_helps(make, name):
    assert_found(
        meta(OwnParameter(make()), lambda env, task: setattr(env, "weight", float(task[0]))),
        rf"{NO_EFFECT}.*MetaTask\(unwrap=False\)",
    )
    remedy = meta(OwnParameter(make()), lambda env, task: env.set_wrapper_attr("weight", float(task[0])), unwrap=False)
    check_meta_env(remedy)


@every_env
def test_an_entry_without_effect_is_a_warning(make, name):
    def forget_one(env, task):
        write(env, name, task[0])
        env.gravty = task[1]

    with pytest.warns(UserWarning, match=r"task\[1\] alone made no difference: look whether apply_task"):
        check_meta_env(meta(make(), forget_one, [[0.5, 1.0], [1.0, 2.0], [2.0, 0.5]]))


def test_entries_that_make_no_task_when_mixed_are_let_be():
    def one_hot(env, task):
        if task.sum() != 1.0:
            raise ValueError(f"task={task} is not one-hot")
        env.g = 5.0 + 5.0 * task[1]

    check_meta_env(meta(PendulumEnv(), one_hot, [[1.0, 0.0], [0.0, 1.0]]))


def test_a_difference_that_shows_late_is_enough():
    env = TransitionObservation(MetaTask(FarReward(), lambda env, task: setattr(env, "wall", task[0]), [[5.0], [9.0]]))
    check_meta_env(env, max_steps=200)


@pytest.mark.parametrize(("name", "tasks"), [("goal_position", [[0.4], [0.45]]), ("max_speed", [[0.05], [0.07]])])
def test_a_goal_that_takes_momentum_is_reached(name, tasks):
    car = gym.make("MountainCarContinuous-v0", max_episode_steps=400)
    check_meta_env(TransitionObservation(MetaTask(car, lambda env, task: setattr(env, name, task[0]), tasks)))


def test_a_difference_in_the_end_is_enough():
    class Ending(PendulumEnv):
        limit = 8.0

        def step(self, action):
            observation, reward, _, truncated, info = super().step(action)
            return observation, reward, bool(abs(observation[2]) > self.limit), truncated, info

    check_meta_env(meta(Ending(), lambda env, task: setattr(env, "limit", float(task[0])), [[0.5], [4.0]]))


def test_an_inverse_of_the_last_change_is_no_trace_though_it_rounds():
    def rescale(env, task):
        env.g *= float(task[0]) / getattr(env, "last_factor", 1.0)
        env.last_factor = float(task[0])

    check_meta_env(meta(PendulumEnv(), rescale, [[0.3], [0.7], [1.1]]))


def test_statistics_of_a_normalising_wrapper_are_neither_an_effect_nor_a_trace():
    check_meta_env(meta(NormalizeReward(PendulumEnv()), lambda env, task: write(env, "g", task[0])))
    env = NormalizeReward(PendulumEnv())
    assert_found(meta(env, lambda env, task: None), NO_EFFECT)
    assert env.update_running_mean


@pytest.mark.parametrize("draw", ["random", "cycle", "fixed"])
def test_tasks_are_compared_however_they_are_drawn(draw):
    assert_found(meta(PendulumEnv(), lambda env, task: None, draw=draw), NO_EFFECT)


def test_a_trial_of_several_episodes_is_checked_too():
    trial = Trial(TimeLimit(PendulumEnv(), 20), 3)
    assert_found(TransitionObservation(MetaTask(trial, lambda env, task: None, FACTORS)), NO_EFFECT)


def test_what_cannot_be_compared_is_let_be():
    assert find_task_without_effect(MetaTask(PendulumEnv())) is None  # one task
    shown = TaskObservation(MetaTask(PendulumEnv(), lambda env, task: None, FACTORS))
    assert find_task_without_effect(shown) is None  # an oracle sees that tasks differ


def test_the_action_space_keeps_its_generator():
    env, other = (meta(PendulumEnv(), lambda env, task: setattr(env, "g", task[0])) for _ in range(2))
    for each in (env, other):
        each.action_space.seed(3)
    find_task_without_effect(env)
    np.testing.assert_array_equal(env.action_space.sample(), other.action_space.sample())


def test_an_environment_that_is_too_slow_says_so():
    with pytest.raises(TimeoutError, match="is too slow to compare its tasks in time"):
        find_task_without_effect(meta(PendulumEnv(), lambda env, task: None), seconds=0.0)
