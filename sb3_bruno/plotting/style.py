"""The look of all figures: colours, panels, bands, legends.

Every figure is made without pyplot, so matplotlib's global state, its backend and its style stay as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from sb3_bruno.evaluation.band import Band
from sb3_bruno.evaluation.floats import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#000000",
)  # Okabe and Ito: colour-blind eyes tell them apart
INK = "#404040"
WIDEST = 44  # characters of the legend that fit above one panel
_WIDEST_TITLE = 54  # characters of a title above one panel; more take a second line


def plot_bands(
    panels: Mapping[str, Mapping[str, Band]],
    path: str | Path,
    x: str,
    y: str,
    note: str,
    levels: Mapping[str, float] | None = None,
) -> None:
    """Draw lines with the range around each, in panels side by side.

    Args:
        panels: for each title, the bands by the name to show in the legend.
        path: the image to write; its suffix chooses the format.
        x: name of the horizontal axis.
        y: name of the vertical axis.
        note: says what line and band are; written below the panels.
        levels: for each title, the oracle's return, drawn as a dashed line.
    """
    names = dict.fromkeys(name for bands in panels.values() for name in bands)
    colors = dict(zip(names, cycle(COLORS), strict=False))  # a name has the same colour in all panels
    figure, axes = _panels(list(panels))
    for (title, bands), panel in zip(panels.items(), axes, strict=True):
        for name, band in bands.items():
            draw_band(panel, band, colors[name], name)
        if levels:
            panel.axhline(levels[title], color=INK, linestyle=(0, (5, 3)), label="oracle")
    _label(figure, axes, x, y, note)
    _add_legend(figure, axes)
    figure.savefig(path, dpi=150)


def _panels(titles: Sequence[str]) -> tuple[Figure, list[Axes]]:
    """Make a figure with a panel for each title, side by side, with one vertical scale."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1.6 + 4.4 * len(titles), 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(titles), sharey=True, squeeze=False)[0])
    for panel, title in zip(panels, titles, strict=True):
        style_panel(panel, title)
    return figure, panels


def as_text(name: str) -> str:
    """Write a name so that matplotlib draws it as it is: a dollar begins a formula, and a first "_" hides a label."""
    text = name.replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def style_panel(panel: Axes, title: str) -> None:
    """Give a panel its title and the look of all figures here."""
    panel.set_title(fill(as_text(title), _WIDEST_TITLE), loc="left", fontsize=12, color=INK)
    panel.spines[["top", "right"]].set_visible(False)
    panel.spines[["left", "bottom"]].set_color(INK)
    panel.tick_params(labelsize=11, colors=INK)
    panel.grid(color="#E6E6E6", linewidth=0.8)
    panel.set_axisbelow(True)


def apart(places: Floats, gap: float) -> Floats:
    """Move places as little as it takes to have them ``gap`` apart, in their order, ``(n,)``.

    Example: 1, 1 and 5 with a gap of 2 become 0, 2 and 5.
    """
    from scipy.optimize import isotonic_regression

    order = np.argsort(places, kind="stable")
    steps = gap * np.arange(len(places))
    moved = np.empty(len(places))
    moved[order] = isotonic_regression(np.asarray(places, dtype=float)[order] - steps).x + steps
    return moved


def draw_band(
    panel: Axes, band: Band, color: str, name: str, *, range_name: str | None = None, linewidth: float = 1.8
) -> None:
    """Draw a line and the range around it; a single point, which makes no line, is drawn as a dot.

    Args:
        panel: the panel to draw on.
        band: line and range.
        color: of both.
        name: of the line, in the legend.
        range_name: of the range, in the legend; None leaves it out.
        linewidth: of the line, in points.
    """
    panel.fill_between(band.x, band.low, band.high, color=color, alpha=0.18, linewidth=0, label=range_name)
    marker = "o" if len(band.x) == 1 else ""
    panel.plot(band.x, band.mean, color=color, linewidth=linewidth, marker=marker, label=as_text(name))


def _label(figure: Figure, panels: Sequence[Axes], x: str, y: str, note: str) -> None:
    """Name the axes, and write the note below the panels."""
    from matplotlib.ticker import EngFormatter

    for panel in panels:
        panel.set_xlabel(x, fontsize=12, color=INK)
        panel.xaxis.set_major_formatter(EngFormatter(sep=""))  # 200k, 1.5M
        panel.margins(x=0.01)
    panels[0].set_ylabel(y, fontsize=12, color=INK)
    figure.supxlabel(note, fontsize=9.5, color="#7A7A7A")


def _add_legend(figure: Figure, panels: Sequence[Axes]) -> None:
    """Put one legend for all panels above them, where it hides no line, and make the figure taller by it."""
    lines = {name: line for panel in panels for line, name in zip(*panel.get_legend_handles_labels(), strict=True)}
    room = WIDEST * len(panels)
    names = [fill(name, room, break_on_hyphens=False) for name in lines]
    n_columns = max(room // (max(map(len, lines)) + 8), 1)  # a sample of a line is as wide as some eight characters
    n_rows = max(sum(name.count("\n") + 1 for name in names[first::n_columns]) for first in range(n_columns))
    figure.set_figheight(figure.get_figheight() + 0.23 * n_rows)  # inches
    handles = list(lines.values())
    look = {"fontsize": 11, "frameon": False, "labelcolor": INK}
    figure.legend(handles, names, loc="outside upper left", ncols=n_columns, **look)
