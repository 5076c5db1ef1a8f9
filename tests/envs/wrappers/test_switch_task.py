"""The task of a running episode can be switched, and nothing else changes."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box

import sb3_bruno_envs
from sb3_bruno_envs import MetaTask, PointDirEnv, TransitionObservation, Trial
from sb3_bruno_envs.registration import FAMILIES

DIRECTIONS = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]
RIGHT = np.array([1.0, 0.0], dtype=np.float32)


def point(**kwargs):
    return MetaTask(PointDirEnv(), PointDirEnv.set_task, DIRECTIONS, name_task=PointDirEnv.name_task, **kwargs)


def test_the_next_step_is_the_first_of_the_new_task():
    env = point()
    env.reset(seed=0, options={"task": [1.0, 0.0]})
    place = env.step(RIGHT)[0]
    told = env.switch_task([0.0, 1.0])
    assert (told["task"].tolist(), told["task_index"], told["task_name"]) == ([0.0, 1.0], 1, "up")
    after, reward, _, _, info = env.step(np.array([0.0, 1.0], dtype=np.float32))
    assert reward == pytest.approx(0.95)
    np.testing.assert_allclose(after, place + np.array([0.0, 0.1]), atol=1e-6)  # nothing was reset
    assert (info["task"].tolist(), info["task_index"], info["task_name"]) == ([0.0, 1.0], 1, "up")
    assert env.switch_task([0.6, 0.8])["task_index"] == -1


def test_it_is_through_the_wrappers_around():
    env = TransitionObservation(point())
    env.reset(seed=0, options={"task": [1.0, 0.0]})
    env.get_wrapper_attr("switch_task")([-1.0, 0.0])
    assert env.step(RIGHT)[4]["task_name"] == "left"


def test_a_fixed_task_is_then_the_new_one():
    env = point(draw="fixed")
    env.reset(seed=0)
    env.switch_task([0.0, 1.0])
    assert env.reset()[1]["task"].tolist() == [0.0, 1.0]


def test_the_other_draws_go_on():
    env, other = point(draw="cycle"), point(draw="cycle")
    env.reset(seed=0), other.reset(seed=0)
    env.switch_task([-1.0, 0.0])
    assert env.reset()[1]["task"].tolist() == other.reset()[1]["task"].tolist()


@pytest.mark.parametrize("task", [[3.0, 0.0], [1.0], "left", [np.nan, 0.0]])
def test_a_task_outside_the_space_is_refused_and_the_old_one_stays(task):
    env = point(task_space=Box(-1.0, 1.0, (2,)))
    env.reset(seed=0, options={"task": [0.0, 1.0]})
    with pytest.raises(ValueError, match="task"):
        env.switch_task(task)
    assert env.step(RIGHT)[4]["task"].tolist() == [0.0, 1.0] and env.unwrapped.direction.tolist() == [0.0, 1.0]


@pytest.mark.mujoco
def test_a_task_that_the_environment_refuses_leaves_the_old_one():
    env = gym.make("AntDir2D-v0")
    env.reset(seed=0, options={"task": [0.0, 1.0]})
    with pytest.raises(ValueError, match="no direction"):
        env.get_wrapper_attr("switch_task")([0.5, 0.5])
    assert env.step(env.action_space.sample())[4]["task_name"] == "left"
    assert env.unwrapped.direction.tolist() == [0.0, 1.0]


def test_a_late_task_is_switched_too():
    env = MetaTask(Trial(PointDirEnv(), 2), lambda trial, task: trial.unwrapped.set_task(task), DIRECTIONS,
                   when="after_reset", unwrap=False)  # fmt: skip
    env.reset(seed=0, options={"task": [1.0, 0.0]})
    env.switch_task([-1.0, 0.0])
    assert env.unwrapped.direction.tolist() == [-1.0, 0.0]


def test_before_the_first_reset_there_is_nothing_to_switch():
    with pytest.raises(ResetNeeded):
        point().switch_task([1.0, 0.0])


@pytest.mark.mujoco
@pytest.mark.parametrize("env_id", FAMILIES)
def test_every_family_switches(env_id):
    """A step of the switched environment is that of one that has had the task from its reset on."""
    assert sb3_bruno_envs
    rewards = []
    for switches in (True, False):
        env = gym.make(env_id)
        tasks = env.get_wrapper_attr("task_distribution").tasks()
        env.reset(seed=0, options={"task": tasks[0 if switches else 1]})
        if switches:
            env.get_wrapper_attr("switch_task")(tasks[1])
        rewards.append(env.step(np.full(env.action_space.shape, 0.5, dtype=np.float32))[1])
    assert rewards[0] == pytest.approx(rewards[1], rel=1e-6)
