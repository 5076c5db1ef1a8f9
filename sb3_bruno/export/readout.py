"""Writes what an agent's read-out of the task was made with, and what tasks are called; makes it again."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sb3_bruno.algorithms.task_estimate import FEW_TASKS, TaskLabels
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders.task_readout import ListReadout
from sb3_bruno.files.shown import shown

LONGEST = 300  # characters of a name: ``task_estimate.LONGEST_NAME``, and eight numbers that tell it from another


def write_readout(model: TaskInference) -> dict[str, Any] | None:
    """Write it as JSON; None if the agent has none."""
    if model.policy.readout is None:
        return None
    tasks = model.policy_kwargs["readout"]["tasks"]
    return {"tasks": tasks, **{f"called_{name}": list(called) for name, called in model.task_labels._asdict().items()}}


def add_readout(model: TaskInference, plain: Any) -> None:
    """Add to an agent without a read-out the one that was written, with weights still to come.

    Raises:
        ValueError: if it is not as ``write_readout`` writes it.
    """
    if plain is None:
        return
    names = [f"called_{name}" for name in TaskLabels._fields]
    if not isinstance(plain, dict) or set(plain) != {"tasks", *names}:
        raise ValueError("its read-out is not told as a whole")
    tasks, task_dim = plain["tasks"], math.prod(model.task_space.shape)
    labels = TaskLabels(*(tuple(map(_name, _list(plain[name]))) for name in names))
    if tasks is not None and not _are_tasks(tasks, task_dim):
        raise ValueError(f"the tasks of its read-out are no {FEW_TASKS} tasks of {task_dim} numbers, or fewer")
    if len(labels.tasks) != len(tasks or ()) or any(len(called) not in (0, task_dim) for called in labels[:2]):
        raise ValueError("its read-out has other names than tasks")
    model.policy_kwargs["readout"] = {"tasks": tasks}
    model.policy.add_readout({"tasks": tasks})
    model._task_labels = labels
    model._setup_readout_training()


def check_tasks(model: TaskInference) -> None:
    """Refuse tasks among the weights of a read-out that are others than those that were written with their names.

    Raises:
        ValueError: if they differ.
    """
    readout = model.policy.readout
    if isinstance(readout, ListReadout):
        named = np.array(model.policy_kwargs["readout"]["tasks"], np.float32)
        if not np.array_equal(named, readout.tasks.cpu().numpy()):
            raise ValueError("the tasks of its read-out are not those that it names")


def _list(plain: Any) -> list[Any]:
    if not isinstance(plain, list):
        raise ValueError("the names of its read-out are no list")
    return plain


def _name(plain: Any) -> str:
    """Read a name, which will be printed: no text that would command a terminal."""
    if not isinstance(plain, str) or len(plain) > LONGEST or not plain.isprintable():
        raise ValueError(f"its read-out has the name {shown(plain)}")
    return plain


def _are_tasks(tasks: Any, task_dim: int) -> bool:
    """Tell whether these are a few tasks of so many numbers."""
    is_list = isinstance(tasks, list) and 0 < len(tasks) <= FEW_TASKS
    if not is_list or not all(isinstance(task, list) and len(task) == task_dim for task in tasks):
        return False
    numbers = [number for task in tasks for number in task]
    return all(type(number) in (int, float) and abs(number) < np.finfo(np.float32).max for number in numbers)
