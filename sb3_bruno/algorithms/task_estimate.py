"""Asks an env which tasks there are, where these are few, and what its tasks are called."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.task_names import one_line, task_labels
from sb3_bruno.task_words import TaskEstimate, TaskLabels

__all__ = ["FEW_TASKS", "TaskEstimate", "TaskLabels", "example_tasks", "few_tasks", "list_tasks", "read_labels"]

LONGEST_NAME = 100
"""Characters of a name that are kept."""
FEW_TASKS = 8
"""Up to so many tasks are told apart one by one, where there are no others."""
MANY_TASKS = 1_000
"""Up to so many tasks of an env are shown to an encoder that does not take all."""


def few_tasks(env: VecEnv) -> NDArray[np.float32] | None:
    """List all tasks of all envs, (n_tasks, task_dim), if these are few; None if they are many, or an env has no list.

    Tasks of the test must be among those of training: else there are others than can be listed. The list is asked for,
    not the distribution that it is of: that may hold a function, which does not come out of another process.
    """
    tasks = list_tasks(env)
    return np.array(tasks, dtype=np.float32) if tasks is not None and 1 < len(tasks) <= FEW_TASKS else None


def list_tasks(env: VecEnv) -> list[list[float]] | None:
    """List the tasks of all envs together, if each env has few; None if one has many, or no list."""
    if not env.has_attr("list_tasks"):
        return None
    listed = env.env_method("list_tasks", FEW_TASKS)
    return None if any(tasks is None for tasks in listed) else _together(listed)


def example_tasks(env: VecEnv) -> list[list[float]]:
    """List up to a thousand tasks of each env, all together; none of envs that do not list them."""
    return _together(env.env_method("example_tasks", MANY_TASKS)) if env.has_attr("example_tasks") else []


def _together(listed: list[list[list[float]]]) -> list[list[float]]:
    """Join the lists of several envs, each task once."""
    return [list(task) for task in dict.fromkeys(tuple(task) for tasks in listed for task in tasks)]


def read_labels(env: VecEnv, tasks: NDArray[np.float32] | None) -> TaskLabels:
    """Ask an env what its tasks are called."""
    entries = env.get_attr("task_entries", 0)[0] if env.has_attr("task_entries") else None
    names, units = zip(*entries, strict=True) if entries else ((), ())
    called = () if tasks is None else _call(env, tasks)
    return TaskLabels(tuple(map(_short, names)), tuple(map(_short, units)), called)


def _call(env: VecEnv, tasks: NDArray[np.float32]) -> tuple[str, ...]:
    """Call tasks as logs do, all differently; those that the env does not name by their numbers, ``"(1, 0)"``."""
    has_names = env.has_attr("name_of")
    names = [_short(env.env_method("name_of", task, indices=0)[0] or "") if has_names else "" for task in tasks]
    labels = zip(names, task_labels(tasks, names), strict=True)
    return tuple(label if name else f"({label.replace('_', ', ')})" for name, label in labels)


def _short(name: str) -> str:
    """Write a name on one line, and not at any length."""
    return one_line(name)[:LONGEST_NAME]
