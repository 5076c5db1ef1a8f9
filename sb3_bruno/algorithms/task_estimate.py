"""Asks an env which tasks there are, where these are few, and what its tasks are called."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.task_words import TaskEstimate, TaskLabels

__all__ = ["FEW_TASKS", "TaskEstimate", "TaskLabels", "few_tasks", "read_labels"]

FEW_TASKS = 8
"""Up to so many tasks are told apart one by one, where there are no others."""


def few_tasks(env: VecEnv) -> NDArray[np.float32] | None:
    """List all tasks of an env, (n_tasks, task_dim), if these are few; None if they are many, or the env has no list.

    Tasks of the test must be among those of training: else there are others than can be listed.
    """
    if not env.has_attr("task_distribution"):
        return None
    listed = getattr(env.get_attr("task_distribution", 0)[0], "tasks", None)
    if not callable(listed):
        return None
    train, test = ({tuple(row) for row in np.asarray(listed(split)).tolist()} for split in ("train", "test"))
    if not 1 < len(train) <= FEW_TASKS or not test <= train:
        return None
    return np.array(list(dict.fromkeys(map(tuple, np.asarray(listed("train")).tolist()))), dtype=np.float32)


def read_labels(env: VecEnv, tasks: NDArray[np.float32] | None) -> TaskLabels:
    """Ask an env what its tasks are called; those that it does not name are called by their numbers."""
    entries = env.get_attr("task_entries", 0)[0] if env.has_attr("task_entries") else None
    names, units = zip(*entries, strict=True) if entries else ((), ())
    return TaskLabels(tuple(names), tuple(units), () if tasks is None else tuple(_name(env, task) for task in tasks))


def _name(env: VecEnv, task: NDArray[np.float32]) -> str:
    named = env.env_method("name_of", task, indices=0)[0] if env.has_attr("name_of") else None
    return named or f"({', '.join(f'{value:g}' for value in task.tolist())})"
