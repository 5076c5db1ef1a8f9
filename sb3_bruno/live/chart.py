"""A chart whose lines scroll with the steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from sb3_bruno.live.history import Lines

GREY = "#868e96"
_HEIGHT = 125  # pixels


class Line(NamedTuple):
    """How a line looks: its colour, its width in pixels, and the lengths of its dashes."""

    colour: str
    width: float = 1.5
    dash: tuple[int, ...] = ()


class Chart:
    """Draws lines over the steps.

    Args:
        gui: where it is added.
        title: what stands above it.
        lines: how they look.
        bands: pairs of lines, the upper one first, between which the second's colour is laid on thinly.
        between: the range of the vertical axis; None: that of the lines.
        linear_to: up to where the vertical axis is linear; beyond it is logarithmic, to a hundred times that. None:
            everywhere.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        title: str,
        lines: Sequence[Line],
        *,
        bands: Sequence[tuple[int, int]] = (),
        between: tuple[float, float] | None = None,
        linear_to: float | None = None,
    ) -> None:
        gui.add_html(f'<div style="font-size:0.8em;font-weight:600;padding:0.2em 1em 0">{title}</div>')
        series: list[dict[str, Any]] = [{}]
        series += [
            {"stroke": look.colour, "width": look.width, "dash": look.dash, "points": {"show": False}} for look in lines
        ]
        vertical: dict[str, Any] = {} if between is None else {"range": between}
        marks: dict[str, Any] = {}
        if linear_to is not None:
            splits = [-10 * linear_to, -linear_to, 0.0, linear_to, 10 * linear_to, 100 * linear_to]
            vertical, marks = {"distr": 4, "asinh": linear_to, "range": (splits[0], splits[-1])}, {"splits": splits}
        thin = {"stroke": "#e9ecef", "width": 1}
        axis = {"font": "11px sans-serif", "stroke": GREY, "grid": thin, "ticks": {**thin, "size": 4}}
        self._chart = gui.add_uplot(
            data=tuple(np.zeros(1) for _ in range(len(lines) + 1)),
            series=tuple(series),
            bands=tuple({"series": (up + 1, low + 1), "fill": lines[low].colour + "30"} for up, low in bands) or None,
            scales={"x": {"time": False}, "y": vertical},
            axes=({**axis, "size": 24}, {**axis, **marks, "size": 42}),
            legend={"show": False},
            cursor={"show": False},
            height=_HEIGHT,
            padding=(8, 12, 0, 0),
        )

    def show(self, steps: NDArray[np.float64], lines: Lines) -> None:
        """Draw lines, each ``(n,)`` as ``steps`` is, of finite numbers: one that is not would empty the chart."""
        self._chart.data = (steps, *lines)
