"""What a task is called: a label in logs and tables, a title in figures. Knows NumPy alone.

The environment may name its tasks ("forward", "1.9 m/s"). The label of a task without a name is made of its numbers.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

FEW_TASKS = 4
"""Up to so many tasks are shown one by one in figures, tables and videos; more are pooled."""

ALL_TASKS = "all"
"""What tasks are called that are pooled, in tables; so no task is."""

FEW_NUMBERS = 8
"""A task of up to so many numbers is called by them; of more, by its place in the list and a name."""

_NUMBERS = re.compile(r"#\d+-[0-9a-f]{6}|(-?[\d.]+(e[+-]?\d+)?)(_-?[\d.]+(e[+-]?\d+)?)*")


def task_label(task: ArrayLike, place: int | None = None) -> str:
    """Return a short name for a task vector, fit for log keys: ``[0.5, -1.0]`` gives ``"0.5_-1"``.

    A vector of more than eight numbers gets a name that is made of them, after its place: ``"#3-a3f09c"``.

    Args:
        task: the vector, ``(dim,)``.
        place: where it stands in a list of tasks, from 0; None or less leaves it out.
    """
    values = np.atleast_1d(np.asarray(task, dtype=np.float64)).round(6) + 0.0  # 6e-17 and -0 become 0
    if len(values) <= FEW_NUMBERS:
        return "_".join(f"{value:g}" for value in values)
    name = hashlib.sha256(values.astype(np.float32).tobytes()).hexdigest()[:6]
    return name if place is None or place < 0 else f"#{place}-{name}"


def task_labels(tasks: ArrayLike, names: Sequence[str] | None = None) -> list[str]:
    """Return labels of a list of tasks, ``(n, dim)``, all different.

    Args:
        tasks: the vectors.
        names: what the environment calls them, ``""`` where it calls one nothing; None if it has no names. Tasks of
            one name are told apart by their numbers, and if these look the same, by their places in the list.
    """
    numbers = [task_label(task, place) for place, task in enumerate(np.asarray(tasks))]
    names = [""] * len(numbers) if names is None else list(map(one_line, names))
    labels = [
        (name if names.count(name) == 1 else f"{name} ({number.replace('_', ', ')})") if name else number
        for name, number in zip(names, numbers, strict=True)
    ]
    while max((count := Counter([ALL_TASKS, *labels])).values()) > 1:
        labels = [label if count[label] == 1 else f"{label} #{place}" for place, label in enumerate(labels)]
    return labels


def one_line(name: str) -> str:
    """Write a name on one line, without what cannot be printed: ``"left\\n up"`` gives ``"left up"``."""
    return " ".join("".join(char if char.isprintable() else " " for char in name).split())


def log_key(label: str) -> str:
    """Write a label so that a log key can end in it: ``"1.9 m/s"`` gives ``"1.9_m_s"``."""
    return re.sub(r"[^\w.+-]+", "_", label).strip("_")


def task_title(task: ArrayLike) -> str:
    """Return the title for a task vector or its label: ``[0.5]`` gives ``"task 0.5"``, ``"1_0"`` ``"task (1, 0)"``.

    A name is its own title.
    """
    label = task if isinstance(task, str) else task_label(task)
    if isinstance(task, str) and not _NUMBERS.fullmatch(label):
        return label
    return f"task ({label.replace('_', ', ')})" if "_" in label else f"task {label}"


def pooled_title(n_tasks: int) -> str:
    """Return the title for tasks that are shown together: ``"30 tasks"``."""
    return f"{n_tasks} tasks"
