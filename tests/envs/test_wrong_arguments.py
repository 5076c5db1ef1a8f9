"""An argument of a wrong kind is refused where it is given, by its name and value and with what to give instead."""

import re

import pytest
from gymnasium.spaces import Box, Discrete

from sb3_bruno_envs import (
    Family,
    MetaTask,
    NoisyTaskObservation,
    PointDirEnv,
    TaskObservation,
    TaskSampler,
    TaskSet,
    TransitionObservation,
    Trial,
    goal_tasks,
    hide_goal,
)

TASKS = [[1.0, 0.0], [-1.0, 0.0]]
SPACE = Box(-1.0, 1.0, (2,))


def meta(**arguments):
    return MetaTask(PointDirEnv(), PointDirEnv.set_task, **{"tasks": TASKS, **arguments})


def noisy(std):
    return NoisyTaskObservation(meta(), std)


def family(**arguments):
    return Family(**{"env_class": PointDirEnv, "tasks": TASKS, **arguments})


def sampler(**arguments):
    return TaskSampler(**{"sample": lambda rng: [0.0, 1.0], "space": SPACE, **arguments})


WRONG = [
    *(
        (make, "task_entries", entries)
        for make in (meta, family)
        for entries in (
            5,
            [5],
            "ab",
            ["ab", "cd"],
            {"a": "b"},
            [("a",)],
            [("a", None)],
            [("a", "b", "c")],
        )
    ),
    (meta, "task_entries", [("a", "b")]),
    (meta, "split", 5),
    (meta, "split", ["train"]),
    (meta, "draw", 5),
    (meta, "when", None),
    (meta, "unwrap", 5),
    (meta, "unwrap", None),
    (meta, "name_task", "left"),
    (family, "task_sets", 5),
    (family, "task_sets", {"beyond": TASKS}),
    (family, "env_class", 5),
    (family, "name_task", "left"),
    (family, "max_episode_steps", "30"),
    (family, "max_episode_steps", True),
    (family, "max_episode_steps", 0),
    (family, "n_episodes", 2.5),
    (sampler, "sample", 5),
    (sampler, "test_sample", [0.0, 1.0]),
    (lambda set_goal: hide_goal(PointDirEnv(), set_goal=set_goal), "set_goal", "goal"),
    (noisy, "std", "wide"),
    (noisy, "std", -1.0),
    *((lambda n_episodes: Trial(PointDirEnv(), n_episodes), "n_episodes", number) for number in (True, 0, "3", 2.5)),
    *((lambda n_train: goal_tasks(PointDirEnv(), n_train), "n_train", number) for number in (True, 0, "3", None)),
    *((wrapper, "env", 5) for wrapper in (MetaTask, TaskObservation, TransitionObservation, goal_tasks, hide_goal)),
    (lambda env: Trial(env, 2), "env", "PointDir-v0"),
]


@pytest.mark.parametrize(("make", "name", "value"), WRONG)
def test_an_argument_is_named_with_its_value_and_a_remedy(make, name, value):
    with pytest.raises(ValueError, match=re.escape(f"{name}={value!r} ") + ".*: (give|use|name|pass|add)"):
        make(**{name: value})


@pytest.mark.parametrize("tasks", [5, "left", [], [[]], [5], {"a": 1}, object(), [[0.0], [0.0, 1.0]]])
def test_tasks_that_are_none_are_refused(tasks):
    with pytest.raises(ValueError, match=r"tasks .*: give"):
        meta(tasks=tasks)


@pytest.mark.parametrize("space", [5, "box", Discrete(3), Box(-1.0, 1.0, (2, 2))])
def test_a_task_space_that_is_none_is_refused(space):
    for make in (
        meta,
        lambda task_space: TaskSet(TASKS, space=task_space),
        lambda task_space: sampler(space=task_space),
        lambda task_space: family()(task_space=task_space),
    ):
        with pytest.raises(ValueError, match=r"task space .* is no vector space: give a Box"):
            make(task_space=space)
