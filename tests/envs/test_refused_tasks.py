"""What is no task of a family is refused by its value and with a remedy, and never named, whoever gives it."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

from sb3_bruno_envs import CheetahDirEnv, MetaTask, PointDirEnv, PointRotationEnv, TaskSet
from sb3_bruno_envs.read_task import read_direction, read_numbers, read_one_hot
from sb3_bruno_envs.registration import FAMILIES

REFUSED = "(?s)task=.*: give "
NO_DIRECTION = "task=.* is no direction: give two numbers of length 1"
NOT_ONE_HOT = r"task=.* is not one-hot: give one of \[\[1, 0\], \[0, 1\]\]"


def read_two_numbers(task):
    return read_numbers(task, 2, "x and y")


def read_one_of_two(task):
    return read_one_hot(task, 2)


@pytest.fixture(params=FAMILIES, scope="module")
def family(request):
    """An environment of each family, with its tasks."""
    return gym.make(request.param, observe="plain")


def test_every_family_refuses_a_wrong_shape_and_numbers_that_are_not_finite(family):
    bare, task = family.unwrapped, family.get_wrapper_attr("task_distribution").tasks("test")[0]
    wrong = [task[1:], np.append(task, task[0]), task[None], task[0], float(task[0]), []]
    for number in (np.nan, np.inf, -np.inf):
        broken = task.copy()
        broken[-1] = number
        wrong += [broken, broken.tolist()]
    for other in wrong:
        with pytest.raises(ValueError, match=REFUSED):
            bare.set_task(other)
    for tasks in (family.get_wrapper_attr("task_distribution").tasks(split) for split in ("train", "test")):
        for own in tasks[:3]:
            bare.set_task(own)


def test_every_family_refuses_tasks_of_another_length_before_it_names_them(family):
    dim = family.get_wrapper_attr("task_space").shape[0] + 1
    with pytest.raises(ValueError, match=REFUSED):
        gym.make(family.spec.id, tasks=[[0.5] * dim], task_space=Box(-1.0, 1.0, (dim,)))


@pytest.mark.parametrize("split", ["train", "test"])
@pytest.mark.parametrize(
    ("env_id", "right", "wrong"),
    [
        ("PointDir-v0", [0.6, 0.8], [0.6, 0.0]),
        ("PointRotation-v0", [-1.0, 0.0], [0.0, 0.0]),
        ("AntDir2D-v0", [0.0, -1.0], [1.0, 1.0]),
        ("CheetahDir-v0", [0.0, 1.0], [1.0, 1.0]),
        ("CheetahGravity-v0", [9.0], [-9.0]),
        ("CheetahParams-v0", [1.0, 2.0, 1.0, -1.0], [1.0, 0.0, 1.0, 1.0]),
        ("CartpoleSwingUp-v0", [0.5, 0.5], [0.5, -0.5]),
    ],
)
def test_a_list_that_holds_a_wrong_task_is_refused_when_the_environment_is_made(env_id, right, wrong, split):
    settings = {"split": split, "task_space": Box(-10.0, 10.0, (len(right),)), "observe": "plain"}
    good, bad = TaskSet([right], [right, right]), TaskSet([right], [right, wrong])
    gym.make(env_id, tasks=good, **settings).reset(seed=0)
    for tasks in (bad, [right, wrong]):
        with pytest.raises(ValueError, match=REFUSED):
            gym.make(env_id, tasks=tasks, **settings)


def test_tasks_without_an_end_are_refused_one_by_one():
    env = gym.make("PointDir-v0", tasks=lambda rng: [0.5, 0.5], disable_env_checker=True)
    with pytest.raises(ValueError, match=NO_DIRECTION):
        env.reset()


@pytest.mark.parametrize(
    ("env_class", "tasks", "message"),
    [
        (PointDirEnv, [[0.1, 0.0], [0.0, 0.0], [0.5, 0.5], [1.0, 1.0]], NO_DIRECTION),
        (PointRotationEnv, [[0.0, 0.0], [0.5, 0.5], [0.0, 1.01]], NO_DIRECTION),
        (CheetahDirEnv, [[1, 1], [0, 0], [0.5, 0.5], [0.6, 0.8], [-1, 0], [2, 0]], NOT_ONE_HOT),
    ],
)
def test_numbers_that_make_no_direction_are_refused(env_class, tasks, message):
    env = env_class()
    for task in tasks:
        with pytest.raises(ValueError, match=message):
            env.set_task(task)


@pytest.mark.parametrize(
    ("env_id", "task"), [("PointDir-v0", [0.1, 0.0]), ("PointRotation-v0", [0.0, 0.0]), ("CheetahDir-v0", [1.0, 1.0])]
)
def test_a_reset_and_a_switch_refuse_them_too(env_id, task):
    env = gym.make(env_id, disable_env_checker=True)  # Gymnasium's fails after a reset that raised
    with pytest.raises(ValueError, match=REFUSED):
        env.reset(seed=0, options={"task": task})
    before = env.reset(seed=0)[1]
    with pytest.raises(ValueError, match=REFUSED):
        env.get_wrapper_attr("switch_task")(task)
    after = env.step(env.action_space.sample())[-1]
    assert after["task_name"] == before["task_name"] and after["task"].tolist() == before["task"].tolist()


def test_a_refused_task_does_not_come_again():
    env = MetaTask(PointDirEnv(), PointDirEnv.set_task, [[0.0, 1.0]], draw="fixed", task_space=Box(-1.0, 1.0, (2,)))
    with pytest.raises(ValueError, match=REFUSED):
        env.reset(seed=0, options={"task": [0.5, 0.5]})
    assert env.reset()[1]["task"].tolist() == [0.0, 1.0]


@pytest.mark.parametrize("task", ["left", None, {}, [[1.0], [1.0, 2.0]], ["a", "b"], [10**400, 0], object()])
@pytest.mark.parametrize("read", [read_two_numbers, read_direction, read_one_of_two])
def test_what_is_no_array_of_numbers_is_refused(read, task):
    with pytest.raises(ValueError, match=REFUSED):
        read(task)


def test_a_task_may_be_rounded_as_it_is_stored():
    for angle in np.linspace(0.0, 6.0, 50):
        direction = np.float32([np.cos(angle), np.sin(angle)])
        assert read_direction(direction).tolist() == direction.tolist()
    assert read_one_hot(np.float32([0, 0, 1]), 3) == 2


def test_what_is_read_is_a_copy():
    task = np.array([0.6, 0.8])
    first, second = read_direction(task), read_two_numbers(task)
    task[0] = 9.0
    assert first[0] == second[0] == 0.6
