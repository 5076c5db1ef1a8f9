"""A chart whose lines scroll with the steps."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import viser
from viser.uplot import Axis, Band, Scale, Series

GREY = "#868e96"
LENGTH = 200
"""How many steps are shown."""
_HEIGHT = 125  # pixels
_THIN = "#e9ecef"


class Line(NamedTuple):
    """How a line looks: its colour, its width in pixels, and the lengths of its dashes."""

    colour: str
    width: float = 1.5
    dash: tuple[float, ...] = ()


class Chart:
    """Draws lines over the last steps.

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
        self._rows: deque[tuple[float, ...]] = deque([(0.0,) * (1 + len(lines))], maxlen=LENGTH)
        self._is_empty = True
        gui.add_html(f'<div style="font-size:0.8em;font-weight:600;padding:0.2em 1em 0">{title}</div>')
        series: list[Series] = [{}]
        for look in lines:
            series.append({"stroke": look.colour, "width": look.width, "dash": look.dash, "points": {"show": False}})
        fills: list[Band] = [{"series": (up + 1, low + 1), "fill": lines[low].colour + "30"} for up, low in bands]
        vertical, axis = _vertical(between, linear_to)
        self._chart = gui.add_uplot(
            data=self._arrays(),
            series=tuple(series),
            bands=tuple(fills) or None,
            scales={"x": {"time": False}, "y": vertical},
            axes=(_axis(24), axis),
            legend={"show": False},
            cursor={"show": False},
            height=_HEIGHT,
            padding=(8, 12, 0, 0),
        )

    def add(self, step: int, values: Sequence[float]) -> None:
        """Take in the values of all lines at one more step, finite numbers: another would empty the chart."""
        if self._is_empty:
            self._rows.clear()
            self._is_empty = False
        self._rows.append((float(step), *map(float, np.nan_to_num(values))))

    def show(self) -> None:
        """Draw what was taken in."""
        self._chart.data = self._arrays()

    def _arrays(self) -> tuple[np.ndarray, ...]:
        return tuple(np.array(self._rows).T)


def _vertical(between: tuple[float, float] | None, linear_to: float | None) -> tuple[Scale, Axis]:
    """Make the vertical scale and its axis."""
    axis = _axis(42)
    if linear_to is None:
        return ({} if between is None else {"range": between}), axis
    marks = (-10 * linear_to, -linear_to, 0.0, linear_to, 10 * linear_to, 100 * linear_to)
    axis["splits"] = marks
    return {"distr": 4, "asinh": linear_to, "range": (marks[0], marks[-1])}, axis


def _axis(size: int) -> Axis:
    """Make an axis of so many pixels."""
    return {
        "font": "11px sans-serif",
        "stroke": GREY,
        "grid": {"stroke": _THIN, "width": 1},
        "ticks": {"stroke": _THIN, "width": 1, "size": 4},
        "size": size,
    }
