"""Draws methods one below the other: the result of each seed as a dot, and what they say together with its interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np

from sb3_bruno.evaluation.floats import Floats
from sb3_bruno.plotting.style import COLORS, GREY, INK, as_text, style_panel

_WIDEST = 44  # characters of a name on one line
_FAR = 3.0  # times the range of the others


class Dots(NamedTuple):
    """The results of a method.

    Attributes:
        each: of each seed, ``(n_seeds,)``.
        value: what they say together.
        low: the lower end of its interval.
        high: the upper end.
    """

    each: Floats
    value: float
    low: float
    high: float


def _far(rows: Sequence[Dots]) -> int | None:
    """Find a row, not the first, that is so far off the others that it would squeeze them; None if there is none."""
    distances = []
    for i, row in enumerate(rows):
        others = np.concatenate([np.append(other.each, other.value) for j, other in enumerate(rows) if j != i])
        gap = max(others.min() - row.value, row.value - others.max(), 0.0)
        distances.append(gap / max(np.ptp(others), 1e-9))
    farthest = int(np.argmax(distances))
    return farthest if farthest > 0 and len(rows) > 2 and distances[farthest] > _FAR else None


def plot_dots(rows: Mapping[str, Dots], path: str | Path, x: str, note: str) -> None:
    """Draw a row for each method, the first on top; a vertical line shows what the first has.

    Of one that is far off all others, the number is written.

    Args:
        rows: by the name to show.
        path: the image to write; its suffix chooses the format.
        x: name of the horizontal axis.
        note: says what dots and lines are; written below.
    """
    from matplotlib.figure import Figure

    names = [fill(as_text(name), _WIDEST) for name in rows]
    n_lines = sum(name.count("\n") + 1 for name in names)
    figure = Figure(figsize=(8.0, 1.3 + 0.36 * n_lines), layout="constrained")
    panel = figure.subplots()
    style_panel(panel, "")
    panel.axvline(next(iter(rows.values())).value, color=GREY, linewidth=1, linestyle=(0, (5, 3)))
    far = _far(list(rows.values()))
    for height, row in enumerate(rows.values()):
        if height == far:
            is_low = row.value < next(iter(rows.values())).value
            told = f"◂ {row.value:.4g}" if is_low else f"{row.value:.4g} ▸"
            place: dict[str, Any] = {"x": 0.01 if is_low else 0.99, "ha": "left" if is_low else "right"}
            panel.text(y=height, s=told, color=COLORS[0], va="center", transform=panel.get_yaxis_transform(), **place)
            continue
        if len(row.each) > 1:
            panel.plot([row.low, row.high], [height, height], color=COLORS[0], linewidth=2.4, solid_capstyle="butt")
            panel.plot(row.each, np.full(len(row.each), height), "o", color=COLORS[1], markersize=4, zorder=3)
        panel.plot(row.value, height, "o", color=COLORS[0], markersize=8, zorder=2)
    panel.set_yticks(range(len(rows)), names)
    panel.set_ylim(len(rows) - 0.5, -0.5)
    panel.grid(axis="y", visible=False)
    panel.set_xlabel(x, fontsize=12, color=INK)
    figure.supxlabel(note, fontsize=9.5, color="#7A7A7A")
    figure.savefig(path, dpi=150)
