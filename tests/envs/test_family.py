"""Tests of Family: what it wraps, in which order, and what it asks of an environment class."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

from sb3_bruno_envs import POINT_DIR_TASKS, Family, PointDirEnv, SparsePointGoalEnv, TaskSampler

GOALS = [[0.0, 1.0], [0.6, 0.8]]


@pytest.mark.parametrize(
    ("kwargs", "layers"),
    [
        ({}, "<TransitionObservation<MetaTask<PointDirEnv instance>>>"),
        ({"observe": "task"}, "<TaskObservation<MetaTask<PointDirEnv instance>>>"),
        ({"observe": "plain"}, "<MetaTask<PointDirEnv instance>>"),
    ],
)
def test_the_order_of_the_wrappers(kwargs, layers):
    assert str(Family(PointDirEnv, POINT_DIR_TASKS)(**kwargs)) == layers


def test_a_trial_lies_inside_the_task_and_its_length_can_be_chosen():
    family = Family(SparsePointGoalEnv, GOALS, n_episodes=3)
    assert str(family(observe="plain")) == "<MetaTask<Trial<SparsePointGoalEnv instance>>>"
    assert family().get_wrapper_attr("n_episodes") == 3
    assert family(n_episodes=1).get_wrapper_attr("n_episodes") == 1


def test_a_family_without_trials_knows_no_number_of_episodes():
    with pytest.raises(TypeError, match="n_episodes"):
        Family(PointDirEnv, POINT_DIR_TASKS)(n_episodes=3)


def test_two_families_share_a_class_and_keep_their_tasks_apart():
    left, up = Family(PointDirEnv, [[-1.0, 0.0]]), Family(PointDirEnv, [[0.0, 1.0]])
    assert left().reset()[1]["task"].tolist() == [-1.0, 0.0]
    assert up().reset()[1]["task"].tolist() == [0.0, 1.0]
    assert left(tasks=[[-1.0, 0.0]], draw="fixed").get_wrapper_attr("task_space") == left.tasks.space


def test_endless_tasks_are_a_family_too():
    circle = TaskSampler(lambda rng: rng.permutation([0.0, 1.0]), Box(0.0, 1.0, (2,)))
    assert Family(PointDirEnv, circle)().reset(seed=0)[1]["task"].sum() == 1.0


def test_a_family_names_the_tasks_of_a_class_that_does_not():
    class Nameless(PointDirEnv):
        name_task = None
        task_entries = None

    assert "task_name" not in Family(Nameless, POINT_DIR_TASKS)().reset(seed=0)[1]
    entries = (("east", "m"), ("north", "m"))
    for env_class in (Nameless, PointDirEnv):
        env = Family(env_class, [[1.0, 0.0]], name_task=lambda task: f"{task[0]:g} east", task_entries=entries)()
        assert env.reset(seed=0)[1]["task_name"] == "1 east" and env.get_wrapper_attr("task_entries") == entries


def test_the_render_modes_are_the_classs_own():
    assert Family(PointDirEnv, POINT_DIR_TASKS).metadata is PointDirEnv.metadata


def test_a_family_survives_the_pickle():
    family = Family(PointDirEnv, POINT_DIR_TASKS, max_episode_steps=30)
    copy = pickle.loads(pickle.dumps(family))
    assert repr(copy) == repr(family)
    np.testing.assert_array_equal(copy(draw="cycle").reset()[1]["task"], [-1.0, 0.0])


def test_a_class_that_takes_no_task_is_refused():
    with pytest.raises(ValueError, match=r"env_class=.*gymnasium.* has no method set_task\(task\): add one"):
        Family(gym.Env, [[0.0]])


def test_tasks_that_are_no_rows_are_refused():
    with pytest.raises(ValueError, match=r"at least one, as an array \(n, dim\)"):
        Family(PointDirEnv, [0.0, 1.0])
