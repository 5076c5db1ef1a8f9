"""Writes what the agent takes its task for, beside the truth: as HTML, and as a row of a chart."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno.plotting.style import COLORS

_ROW = '<div style="display:flex;gap:0.5em;align-items:center;margin:0.15em 0">{}</div>'


def color_of(place: int) -> str:
    """Return the colour of the task, or the task's number, in that place."""
    return COLORS[place % len(COLORS)]


def page_part(text: str) -> str:
    """Put HTML into a part of the panel."""
    return f'<div style="padding:0.3em 1em;font-size:0.95em">{text}</div>'


def told(estimate: TaskEstimate, task: NDArray[np.float32] | None) -> str:
    """Write an estimate of one agent, the probability of each of a few tasks or each of a task's numbers.

    Args:
        estimate: batch shape (1,).
        task: the true task, ``(task_dim,)``; None if the environment names none.
    """
    return page_part("".join(_numbers(estimate, task) if estimate.tasks is None else _chances(estimate, task)))


def chart_row(estimate: TaskEstimate, task: NDArray[np.float32] | None, most: int) -> list[float]:
    """Return what a chart shows of an estimate: each probability, or four values of each number, at most so many.

    The four are the ends of its spread, upper and lower, its mean and the truth, which where it is unknown lies hidden
    behind the mean.
    """
    if estimate.probabilities is not None:
        return [float(probability) for probability in estimate.probabilities[0]]
    mean, std = estimate.mean[0], estimate.std[0]
    values = np.stack([mean + std, mean - std, mean, mean if task is None else task], axis=-1)  # (task_dim, 4)
    return [float(value) for value in values[:most].ravel()]


def _chances(estimate: TaskEstimate, task: NDArray[np.float32] | None) -> list[str]:
    """Write the probability of each of a few tasks with a bar, and mark the true one."""
    assert estimate.tasks is not None and estimate.probabilities is not None  # for mypy
    truth = -1 if task is None else place_of(task, estimate.tasks)
    rows = []
    for place, (label, probability) in enumerate(zip(estimate.labels.tasks, estimate.probabilities[0], strict=True)):
        mark = " ◂ true" if place == truth else ""
        bar = f'<div style="width:{100 * probability:.0f}%;height:0.7em;background:{color_of(place)}"></div>'
        name = f'<span style="min-width:11em">{escape(label)} {probability:.2f}{mark}</span>'
        rows.append(_ROW.format(f'{name}<div style="flex:1;background:#e9ecef">{bar}</div>'))
    return rows


def _numbers(estimate: TaskEstimate, task: NDArray[np.float32] | None) -> list[str]:
    """Write each of a task's numbers with its spread, and the true one beside it, where it is known."""
    rows = []
    for place, text in enumerate(_entries(estimate)):
        colour = f'<span style="color:{color_of(place)}">■</span>'
        truth = "" if task is None else f"true {task[place]:.3g}"
        rows.append(_ROW.format(f"{colour}<b>{escape(text)}</b><span>{truth}</span>"))
    return rows


def _entries(estimate: TaskEstimate) -> list[str]:
    """Say each of a task's numbers by itself, as the estimate says them all."""
    dim, labels = estimate.mean.shape[-1], estimate.labels
    names = labels.names or tuple(f"task[{place}]" for place in range(dim))
    units = labels.units or ("",) * dim
    parts = [TaskLabels((name,), (unit,)) for name, unit in zip(names, units, strict=True)]
    mean, std = estimate.mean[..., None], estimate.std[..., None]  # (..., task_dim, 1)
    return [TaskEstimate(mean[:, i], std[:, i], None, None, part).texts()[0] for i, part in enumerate(parts)]


def place_of(task: ArrayLike, tasks: NDArray[np.float32]) -> int:
    """Return which row of ``tasks`` is the task, or -1."""
    found = np.flatnonzero(np.isclose(tasks, task, atol=1e-5).all(axis=1))
    return int(found[0]) if len(found) else -1
