"""What a task is called: a label in logs and tables, a title in figures. Knows NumPy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

FEW_TASKS = 4
"""Up to so many tasks are shown one by one in figures, tables and videos; more are pooled."""


def task_label(task: ArrayLike) -> str:
    """Return a short name for a task vector, fit for log keys: ``[0.5, -1.0]`` gives ``"0.5_-1"``."""
    values = np.atleast_1d(np.asarray(task, dtype=np.float64)).round(6) + 0.0  # 6e-17 and -0 become 0
    return "_".join(f"{value:g}" for value in values)


def task_title(task: ArrayLike) -> str:
    """Return the title for a task vector or its label: ``[0.5]`` gives ``"task 0.5"``, ``"1_0"`` ``"task (1, 0)"``."""
    label = task if isinstance(task, str) else task_label(task)
    return f"task ({label.replace('_', ', ')})" if "_" in label else f"task {label}"


def pooled_title(n_tasks: int) -> str:
    """Return the title for tasks that are shown together: ``"30 tasks"``."""
    return f"{n_tasks} tasks"
