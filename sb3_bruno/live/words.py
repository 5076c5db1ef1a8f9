"""Writes what the agent takes its task for as HTML, beside the truth."""

from __future__ import annotations

from collections.abc import Sequence
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


def chances(labels: Sequence[str], probabilities: Sequence[float], truth: int) -> str:
    """Write the probability of each of a few tasks with a bar, and mark the true one.

    Args:
        labels: what the tasks are called.
        probabilities: how probable each is.
        truth: the place of the true one; -1 if it is none of them.
    """
    rows = []
    for place, (label, probability) in enumerate(zip(labels, probabilities, strict=True)):
        mark = " ◂ true" if place == truth else ""
        bar = f'<div style="width:{100 * probability:.0f}%;height:0.7em;background:{color_of(place)}"></div>'
        name = f'<span style="min-width:11em">{escape(label)} {probability:.2f}{mark}</span>'
        rows.append(_ROW.format(f'{name}<div style="flex:1;background:#e9ecef">{bar}</div>'))
    return page_part("".join(rows))


def numbers(estimate: TaskEstimate, task: NDArray[np.float32] | None) -> str:
    """Write each of a task's numbers with its spread, and the true one beside it, where it is known."""
    rows = []
    for place, text in enumerate(_entries(estimate)):
        colour = f'<span style="color:{color_of(place)}">■</span>'
        truth = "" if task is None else f"true {task[place]:.3g}"
        rows.append(_ROW.format(f"{colour}<b>{escape(text)}</b><span>{truth}</span>"))
    return page_part("".join(rows))


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
