"""Tests of the named task sets: what they hold, that their names are found, and that families share one scheme."""

import importlib
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box

from sb3_bruno_envs import POINT_DIR_TASKS, Family, PointDirEnv, TaskSet, point_goal_tasks
from sb3_bruno_envs.registration import FAMILIES

README = (Path(__file__).parents[2] / "README.md").read_text().splitlines()


def named_sets():
    """(id, arguments) of every named set of every family; the dimension of the point's goals decides which it has."""
    for env_id, place in FAMILIES.items():
        module, _, name = place.partition(":")
        family = getattr(importlib.import_module(module), name)
        for dim in ({"dim": 1}, {"dim": 2}, {}) if env_id == "PointGoal-v0" else ({},):
            marks = [pytest.mark.mujoco] * (".mujoco." in place)
            for tasks in family.tasks_for(dim)[1]:
                yield pytest.param(env_id, {**dim, "tasks": tasks}, marks=marks, id=f"{env_id} {tasks} {dim}")


named = pytest.mark.parametrize(("env_id", "kwargs"), list(named_sets()))


def make(env_id, **kwargs):
    return gym.make(f"sb3_bruno_envs:{env_id}", **kwargs)


def task_set(env_id, **kwargs):
    """The tasks of an environment that is made with these arguments."""
    return make(env_id, **kwargs).get_wrapper_attr("task_distribution")


@named
def test_a_name_gives_its_tasks_and_their_space_also_after_the_json(env_id, kwargs):
    env = make(env_id, split="test", draw="cycle", **kwargs)
    tasks = env.get_wrapper_attr("task_distribution")
    assert env.get_wrapper_attr("task_space") == tasks.space
    np.testing.assert_array_equal(env.reset(seed=0)[1]["task"], tasks.tasks("test")[0])
    spec = replace(gym.spec(env_id), kwargs=kwargs)
    assert gym.make(EnvSpec.from_json(spec.to_json())).get_wrapper_attr("task_distribution") == tasks


@named
def test_beyond_trains_on_the_familys_own_tasks_and_tests_outside_their_range(env_id, kwargs):
    own = {key: value for key, value in kwargs.items() if key != "tasks"}
    tasks, familys = task_set(env_id, **kwargs), task_set(env_id, **own)
    if kwargs["tasks"] == "beyond":
        np.testing.assert_array_equal(tasks.tasks("train"), familys.tasks("train"))
        assert tasks.train_box == familys.train_box
        assert not tasks.inside_train_box(tasks.tasks("test")).any()
    assert tasks != familys


@named
def test_the_readme_names_every_set_beside_its_family(env_id, kwargs):
    assert any(line.startswith(f'| `"{kwargs["tasks"]}"` | `{env_id}`') for line in README)


def test_the_published_goals_of_the_point_are_those_of_its_seed():
    tasks = task_set("PointGoal-v0", dim=2, tasks="pearl")
    assert (len(tasks.tasks("train")), len(tasks.tasks("test"))) == (80, 20)
    train = [[-0.475951, -0.682632], [-0.443747, -0.081366], [-0.357999, 0.036785], [0.100412, 0.811501]]
    np.testing.assert_allclose(tasks.tasks("train")[[0, 1, 2, -1]], train, atol=2e-6)
    np.testing.assert_allclose(tasks.tasks("test")[[0, -1]], [[0.796638, -0.475195], [0.704233, 0.094872]], atol=2e-6)


def test_the_published_goals_of_the_sparse_point_are_in_the_order_of_their_seed():
    tasks = task_set("SparsePointGoal-v0", tasks="pearl")
    assert (len(tasks.tasks("train")), len(tasks.tasks("test"))) == (80, 20)
    train = [[0.997987, 0.063424], [0.047582, 0.998867], [-0.916108, 0.400931], [-0.723734, 0.690079]]
    np.testing.assert_allclose(tasks.tasks("train")[[0, 1, 2, -1]], train, atol=2e-6)
    np.testing.assert_allclose(tasks.tasks("test")[[0, -1]], [[-0.5, 0.866025], [0.745264, 0.666769]], atol=2e-6)


@pytest.mark.mujoco
def test_the_velocities_with_a_gap_are_those_of_their_seed():
    tasks = task_set("CheetahVel-v0", tasks="tavt")
    train, test = tasks.tasks("train").ravel(), tasks.tasks("test").ravel()
    np.testing.assert_allclose(train[[0, 1, 2, -1]], [0.131012, 0.079342, 0.139063, 3.062701], atol=2e-6)
    assert test.tolist() == [0.75, 1.25, 1.75, 2.25, 2.75]
    assert ((train[:50] >= 0.0) & (train[:50] <= 0.5)).all() and ((train[50:] >= 3.0) & (train[50:] <= 3.5)).all()
    assert (len(train), tasks.space) == (100, Box(0.0, 3.5, (1,)))


def test_goals_beyond_the_cube_lie_in_a_frame_around_it():
    tasks = task_set("PointGoal-v0", tasks="beyond")
    assert (len(tasks.tasks("test")), tasks.space) == (20, Box(-1.5, 1.5, (3,)))
    largest = np.abs(tasks.tasks("test")).max(axis=1)
    assert (largest > 1.0).all() and (largest < 1.5).all()
    own = task_set("PointGoal-v0")
    assert (own, own.space) == (point_goal_tasks(3), Box(-1.0, 1.0, (3,)))  # as it was before there were others


@pytest.mark.parametrize(
    ("env_id", "kwargs", "message"),
    [
        ("CheetahVel-v0", {"tasks": "tvat"}, r"tasks='tvat' is no task set of CheetahVelEnv: give one of \['tavt'\]"),
        ("PointDir-v0", {"tasks": "beyond"}, r"tasks='beyond' is no task set of PointDirEnv: give an array \(n, dim\)"),
        ("PointGoal-v0", {"tasks": ""}, r"tasks='' is no task set of PointGoalEnv: give one of \['beyond'\]"),
        ("PointGoal-v0", {"tasks": "pearl"}, r"tasks='pearl' are goals in the plane: give dim=2"),
        ("PointGoal-v0", {"tasks": [[0.5, 0.5]]}, "tasks have 2 dimensions, the task space .* has 3"),
        ("Wind-v0", {"tasks": "beyond", "task_space": Box(-0.08, 0.08, (2,))}, "widen task_space"),
    ],
)
def test_a_name_that_is_not_there_is_named(env_id, kwargs, message):
    with pytest.raises(ValueError, match=message):
        make(env_id, **kwargs)


def test_a_family_of_ones_own_has_named_sets_too():
    up = TaskSet([[0.0, 1.0]], space=Box(0.0, 2.0, (2,)))
    family = Family(PointDirEnv, POINT_DIR_TASKS, task_sets={"up": up})
    env = family(tasks="up", observe="plain")
    assert env.reset(seed=0)[1]["task"].tolist() == [0.0, 1.0]
    assert env.get_wrapper_attr("task_space") == up.space
    assert family().get_wrapper_attr("task_space") == POINT_DIR_TASKS.space
    assert family(tasks="up", task_space=Box(-2.0, 2.0, (2,))).get_wrapper_attr("task_space") == Box(-2.0, 2.0, (2,))


@pytest.mark.parametrize("env_id", ["CartpoleSwingUp-v0", pytest.param("CheetahParams-v0", marks=pytest.mark.mujoco)])
def test_beyond_is_the_outer_part_of_a_familys_own_test_tasks(env_id):
    own, beyond = task_set(env_id), task_set(env_id, tasks="beyond")
    test = own.tasks("test")
    np.testing.assert_array_equal(beyond.tasks("test"), test[~own.inside_train_box(test)])
