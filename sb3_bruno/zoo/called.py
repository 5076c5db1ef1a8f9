"""Calls the tasks of old records as their environment does today: "forward", where a record says "0_1"."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_bruno.runs.record import RunRecord
from sb3_bruno.task_names import task_labels

Naming = Callable[[Any], str | None]


def with_names(record: RunRecord) -> RunRecord:
    """Return a record whose tasks have names, where it has numbers and the environment is installed and names them."""
    labels: list[str] = record.episodes["task"].unique().tolist()
    tasks = [_numbers(label) for label in labels]
    named = _naming(str(record.about["config"]["env"]))
    if named is None or None in tasks:
        return record
    names = [named(np.array(task, dtype=np.float32)) or "" for task in tasks]
    new = dict(zip(labels, task_labels(np.array(tasks), names), strict=True))
    tables = [table.assign(task=table["task"].map(lambda label: new.get(label, label))) for table in record[1:]]
    steps = {new.get(label, label): step for label, step in record.about["steps_to_90"].items()}
    return RunRecord({**record.about, "steps_to_90": steps}, *tables)


@cache
def _naming(env_id: str) -> Naming | None:
    """Ask an environment how it names tasks, and nothing that is none; None if it does not, or cannot be made."""
    importlib.import_module("sb3_bruno_envs")
    if env_id not in gym.registry:  # Gymnasium would import what stands before a colon
        return None
    try:
        env = gym.make(env_id)
    except gym.error.Error:
        return None
    try:
        if not env.has_wrapper_attr("name_of") or not env.has_wrapper_attr("task_space"):
            return None
        name, space = env.get_wrapper_attr("name_of"), env.get_wrapper_attr("task_space")
        return lambda task: name(task) if space.contains(task) else None
    finally:
        env.close()


def _numbers(label: str) -> list[float] | None:
    """Read the numbers that a label is made of: ``"0.5_-1"`` gives ``[0.5, -1]``; None if it is a name."""
    try:
        return [float(number) for number in label.split("_")]
    except ValueError:
        return None
