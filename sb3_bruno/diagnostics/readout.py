"""Compares what a read-out took each task for with the task itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno.diagnostics.verdict import TRUE_TASK
from sb3_bruno.evaluation.floats import Floats

WITHIN_90 = 1.645
"""Standard deviations of a Gaussian that hold 90 %, on either side."""


class ReadoutFindings(NamedTuple):
    """How far a read-out is off after 0, 1, ... transitions: see the attributes ``readout_...`` of ``Diagnostics``.

    Attributes:
        entries: what the misses are of, ``(n_entries,)``.
        misses: ``(n_tasks, n_episodes, horizon + 1, n_entries)``.
        holds: of the same shape.
    """

    entries: list[str]
    misses: Floats
    holds: Floats


def compare_readout(tasks: Floats, estimates: Sequence[TaskEstimate], is_known: NDArray[np.bool_]) -> ReadoutFindings:
    """Compare estimates with the tasks, ``(n_tasks, task_dim)``.

    Args:
        tasks: the true tasks.
        estimates: of each task, batch shape ``(n_episodes, horizon + 1)``.
        is_known: False after an episode's end, ``(n_tasks, n_episodes, horizon + 1)``.
    """
    compared = [_compare(task, estimate) for task, estimate in zip(tasks, estimates, strict=True)]
    misses, holds = (np.where(is_known[..., None], np.stack(parts), np.nan) for parts in zip(*compared, strict=True))
    first = estimates[0]
    if first.probabilities is not None:
        return ReadoutFindings([TRUE_TASK], misses, holds)
    return ReadoutFindings(_entries(first.labels, tasks.shape[-1]), misses, holds)


def _compare(task: Floats, estimate: TaskEstimate) -> tuple[Floats, Floats]:
    """Return misses and what holds for one task, ``(n_episodes, horizon + 1, n_entries)`` each."""
    if estimate.probabilities is not None and estimate.tasks is not None:
        true = int(np.square(estimate.tasks - task).sum(axis=-1).argmin())
        chances = estimate.probabilities.astype(float)
        return 1.0 - chances[..., [true]], (chances.argmax(axis=-1) == true)[..., None].astype(float)
    misses = np.abs(estimate.mean - task)
    return misses, (misses <= WITHIN_90 * estimate.std).astype(float)


def _entries(labels: TaskLabels, task_dim: int) -> list[str]:
    """Name the entries of a task, with units: ``"velocity, m/s"``."""
    names = labels.names or tuple(f"task[{i}]" for i in range(task_dim))
    units = labels.units or ("",) * task_dim
    return [f"{name}, {unit}" if unit else name for name, unit in zip(names, units, strict=True)]
