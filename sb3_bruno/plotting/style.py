"""The one look of all figures, and the drawing of lines with bands.

The figure is made without pyplot, so matplotlib's global state, its backend and its style stay as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from sb3_bruno.evaluation.band import Band
from sb3_bruno.evaluation.floats import Floats
from sb3_bruno.plotting.names import ORACLE

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
GREY = "#9A9A9A"
"""Of lines that are no method's: the ideal, the truth, borders of episodes."""

FIRST_STEPS = 60
"""Steps that are drawn large, in which an agent finds its task out."""

WIDEST = 44  # characters of the legend that fit above one panel
_WIDEST_TITLE = 54  # characters of a title above one panel; more take a second line
_FEW, _SHORT = 4, 32  # up to so many lines, with names of up to so many characters, are named at their ends


def plot_bands(
    panels: Mapping[str, Mapping[str, Band]],
    path: str | Path,
    x: str,
    y: str,
    note: str,
    levels: Mapping[str, float] | None = None,
    *,
    first: int | None = None,
    borders: Sequence[float] = (),
    log: bool = False,
    highest: float | None = None,
) -> None:
    """Draw lines with the range around each, in panels side by side.

    A few lines are named at their ends, more in a legend.

    Args:
        panels: for each title, the bands by the name to show.
        path: the image to write; its suffix chooses the format.
        x: name of the horizontal axis.
        y: name of the vertical axis.
        note: says what line and band are; written below the panels.
        levels: for each title, the return of the agent that is told the task, drawn as a dashed line.
        first: draw up to here large, and everything small below; None draws everything large.
        borders: where episodes end within a trial.
        log: whether the vertical axis is logarithmic.
        highest: lines leave the picture above this value; None draws all.
    """
    panels = {
        title: known
        for title, bands in panels.items()
        if (known := {name: band for name, band in bands.items() if len(band.x) > 0 and not np.isnan(band.mean).all()})
    }
    if not panels:
        return  # as of runs that share no evaluation
    names = dict.fromkeys(name for bands in panels.values() for name in bands)
    colors = dict(zip(names, cycle(COLORS), strict=False))  # a name has the same colour in all panels
    last = max(float(band.x[-1]) for bands in panels.values() for band in bands.values())
    figure, rows = _panels(list(panels), n_rows=1 if first is None or last <= first else 2)
    for row in rows:
        for (title, bands), panel in zip(panels.items(), row, strict=True):
            for name, band in bands.items():
                draw_band(panel, band, colors[name], name, opacity=0.18 if len(names) <= _FEW else 0.07)
            if levels:
                panel.axhline(levels[title], color=INK, linestyle=(0, (5, 3)), label=ORACLE)
            for border in borders:
                panel.axvline(border, color=GREY, linewidth=1, linestyle=(0, (2, 2)), zorder=0)
            panel.margins(x=0.01)
    if len(rows) > 1:
        for panel in rows[0]:
            panel.set_xlim(1, first)
        rows[1][0].locator_params(axis="y", nbins=4)
    if log:
        _make_logarithmic(rows[0])
    if highest is not None:
        lowest = min(float(np.nanmin(band.low)) for bands in panels.values() for band in bands.values())
        rows[0][0].set_ylim(lowest - 0.04 * (highest - lowest), highest)
    _label(figure, rows, x, y, note)
    if not _name_at_ends(rows[0]):
        _add_legend(figure, rows[0])
    figure.savefig(path, dpi=150)


def _panels(titles: Sequence[str], n_rows: int) -> tuple[Figure, list[list[Axes]]]:
    """Make a figure with a panel for each title, side by side, with one vertical scale; a second row is lower."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1.6 + 4.4 * len(titles), 4.2 if n_rows == 1 else 5.8), layout="constrained")
    heights = [3.0, 1.2][:n_rows]
    grid = figure.subplots(n_rows, len(titles), sharey="row", squeeze=False, height_ratios=heights)
    rows: list[list[Axes]] = [list(row) for row in grid]
    for row, shown in zip(rows, (titles, [""] * len(titles)), strict=False):
        for panel, title in zip(row, shown, strict=True):
            style_panel(panel, title)
    return figure, rows


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
    panel: Axes,
    band: Band,
    color: str,
    name: str,
    *,
    range_name: str | None = None,
    linewidth: float = 1.8,
    opacity: float = 0.18,
) -> None:
    """Draw a line and the range around it; a single point, which makes no line, is drawn as a dot.

    Args:
        panel: the panel to draw on.
        band: line and range.
        color: of both.
        name: of the line.
        range_name: of the range, in the legend; None leaves it out.
        linewidth: of the line, in points.
        opacity: of the range.
    """
    panel.fill_between(band.x, band.low, band.high, color=color, alpha=opacity, linewidth=0, label=range_name)
    marker = "o" if len(band.x) == 1 else ""
    panel.plot(band.x, band.mean, color=color, linewidth=linewidth, marker=marker, label=as_text(name))


def _label(figure: Figure, rows: Sequence[Sequence[Axes]], x: str, y: str, note: str) -> None:
    """Name the axes, and write the note below the panels."""
    from matplotlib.ticker import EngFormatter

    for panel in (panel for row in rows for panel in row):
        if panel.get_xlim()[1] >= 1_000:
            panel.xaxis.set_major_formatter(EngFormatter(sep=""))  # 200k, 1.5M
    for panel in rows[-1]:
        panel.set_xlabel(x, fontsize=12, color=INK)
    rows[0][0].set_ylabel(y, fontsize=12, color=INK)
    figure.supxlabel(note, fontsize=9.5, color="#7A7A7A")


def _make_logarithmic(panels: Sequence[Axes]) -> None:
    """Make the vertical axis of panels that share it logarithmic, with numbers as people write them."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    panels[0].set_yscale("log")
    axis = panels[0].yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _name_at_ends(panels: Sequence[Axes]) -> bool:
    """Name lines where they end, right of the last panel; say whether that was possible."""
    last = panels[-1]
    lines: dict[str, Any] = dict(zip(*reversed(last.get_legend_handles_labels()), strict=True))
    every = {name for panel in panels for name in panel.get_legend_handles_labels()[1]}
    ends = {name: _end(line, last) for name, line in lines.items()}
    if len(every) > _FEW or max(map(len, every)) > _SHORT or every != set(lines) or np.isnan([*ends.values()]).any():
        return False
    places = apart(np.array([*ends.values()]), gap=0.065)
    for (name, line), place in zip(lines.items(), places, strict=True):
        look: dict[str, Any] = {"color": line.get_color(), "fontsize": 11, "va": "center"}
        last.text(1.015, place, name, transform=last.transAxes, **look)
    return True


def _end(line: Any, panel: Axes) -> float:
    """Return where a line ends within its panel, 0 at the bottom and 1 at the top; NaN if it is not drawn there."""
    xs, ys = (np.asarray(numbers, dtype=float) for numbers in line.get_data())
    is_shown = ((xs <= panel.get_xlim()[1]) | (line.get_transform() != panel.transData)) & np.isfinite(ys)
    if not is_shown.any():
        return np.nan
    _, height = panel.transAxes.inverted().transform(panel.transData.transform((1.0, ys[is_shown][-1])))
    return float(np.clip(height, 0.0, 1.0))


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
