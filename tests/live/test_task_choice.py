"""How people may choose a task follows from the environment's tasks, whoever made it."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

import sb3_bruno_envs
from sb3_bruno.live.task_choice import Direction, Entries, FewTasks, OnlyDrawn, can_draw, find_choice
from sb3_bruno_envs import MetaTask, PointDirEnv, TaskSampler, TaskSet
from sb3_bruno_envs.registration import FAMILIES

CHOICES = {
    "CheetahDir-v0": FewTasks,
    "AntDir-v0": FewTasks,
    "PointDir-v0": FewTasks,
    "AntDir2D-v0": Direction,
    "HumanoidDir-v0": Direction,
    "PointRotation-v0": Direction,
    "SparsePointGoal-v0": Direction,
}
"""Of the families; those of all others are numbers."""


def set_nothing(env, task):
    """Ignore the task."""


def tasked(tasks, **kwargs):
    return MetaTask(PointDirEnv(), set_nothing, tasks, **kwargs)


def sampled(low, high):
    return TaskSampler(lambda rng: rng.uniform(-1.0, 1.0, 2), Box(low, high, (2,)))


@pytest.mark.mujoco
@pytest.mark.parametrize("env_id", FAMILIES)
def test_every_familys_task_can_be_chosen(env_id):
    assert sb3_bruno_envs
    env = gym.make(env_id)
    choice = find_choice(env)
    assert type(choice) is CHOICES.get(env_id, Entries)
    distribution = env.get_wrapper_attr("task_distribution")
    if isinstance(choice, Entries):
        np.testing.assert_allclose(choice.low, distribution.train_box.low)
        np.testing.assert_allclose(choice.high, distribution.train_box.high)
        assert len(set(choice.labels)) == len(choice.low)
    if isinstance(choice, Direction):
        for task in distribution.tasks("train"):
            np.testing.assert_allclose(choice.task(choice.degrees(task)), task, atol=1e-4)


def test_few_tasks_are_those_of_both_splits_each_once():
    choice = find_choice(tasked(TaskSet([[0.0], [1.0]], [[1.0], [2.0]])))
    assert choice.tasks.tolist() == [[0.0], [1.0], [2.0]] and choice.labels == ["0", "1", "2"]


@pytest.mark.parametrize(("n", "kind"), [(2, FewTasks), (8, FewTasks), (9, Entries)])
def test_more_than_eight_tasks_are_chosen_by_their_numbers(n, kind):
    assert isinstance(find_choice(tasked(np.linspace(0.0, 2.0, n)[:, None])), kind)


def test_one_task_and_none_leave_no_choice():
    assert find_choice(tasked([[0.5]])) is None
    assert find_choice(MetaTask(PointDirEnv())) is None
    assert find_choice(PointDirEnv()) is None


def test_a_direction_is_an_angle_within_those_of_training():
    angles = np.deg2rad(np.linspace(10.0, 100.0, 10))
    choice = find_choice(tasked(np.stack([np.cos(angles), np.sin(angles)], axis=1), task_space=Box(-1.0, 1.0, (2,))))
    assert (choice.low, choice.high) == pytest.approx((10.0, 100.0), abs=1e-3)
    np.testing.assert_allclose(choice.task(90.0), [0.0, 1.0], atol=1e-6)
    assert choice.degrees([0.0, -1.0]) == pytest.approx(10.0, abs=1e-3)


@pytest.mark.parametrize(("low", "high"), [(150.0, 210.0), (120.0, 240.0), (-30.0, 30.0), (90.0, 270.0), (-180.0, 0.0)])
def test_directions_are_bounded_on_the_circle(low, high):
    angles = np.deg2rad(np.linspace(low, high, 12))
    choice = find_choice(tasked(np.stack([np.cos(angles), np.sin(angles)], axis=1), task_space=Box(-1.0, 1.0, (2,))))
    turns = round((choice.low - low) / 360.0) * 360.0
    assert (choice.low, choice.high) == pytest.approx((low + turns, high + turns), abs=1e-3)
    for degrees in (low, (low + high) / 2, high):
        task = choice.task(degrees)
        np.testing.assert_allclose(choice.task(choice.degrees(task)), task, atol=1e-4)
    for degrees, bound in ((low - 20.0, choice.low), (high + 20.0, choice.high)):
        assert choice.degrees(choice.task(degrees)) == pytest.approx(bound, abs=1e-3)


@pytest.mark.parametrize("n", [9, 12])
def test_directions_all_around_have_no_bounds(n):
    angles = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    tasks = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    assert find_choice(tasked(tasks, task_space=Box(-1.0, 1.0, (2,)))) == Direction(-180.0, 180.0)


class Own(PointDirEnv):
    """Has a hidden task of its own, without a distribution that draws it."""

    def __init__(self, high):
        super().__init__()
        self.task_space = Box(0.0, high, (2,))


def test_an_env_that_draws_tasks_itself_is_bounded_by_its_space():
    choice = find_choice(Own(2.0))
    assert (choice.low.tolist(), choice.high.tolist(), choice.labels) == ([0.0, 0.0], [2.0, 2.0], ["x", "y"])
    assert find_choice(Own(np.inf)) == OnlyDrawn()
    assert not can_draw(Own(2.0)) and can_draw(tasked(sampled(-1.0, 2.0)))


def test_endless_tasks_are_bounded_by_their_space():
    choice = find_choice(tasked(sampled(-1.0, 2.0)))
    assert (choice.low.tolist(), choice.high.tolist()) == ([-1.0, -1.0], [2.0, 2.0])


def test_endless_tasks_without_bounds_can_only_be_drawn():
    assert find_choice(tasked(sampled(-np.inf, np.inf))) == OnlyDrawn()


def test_a_box_without_bounds_takes_those_of_its_tasks():
    tasks = TaskSet(np.arange(20.0)[:, None], space=Box(-np.inf, np.inf, (1,)), train_box=Box(0.0, np.inf, (1,)))
    choice = find_choice(tasked(tasks))
    assert (choice.low.tolist(), choice.high.tolist()) == ([0.0], [19.0])
