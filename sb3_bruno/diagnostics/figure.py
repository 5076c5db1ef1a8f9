"""Draws a belief's diagnostics in one figure, whose head is the verdict."""

from __future__ import annotations

import math
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from sb3_bruno.diagnostics.result import Diagnostics
from sb3_bruno.diagnostics.verdict import TRUE_TASK, verdict
from sb3_bruno.evaluation.band import Band
from sb3_bruno.plotting.style import COLORS, FIRST_STEPS, GREY, INK, as_text, draw_band, style_panel
from sb3_bruno.task_names import task_labels, task_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_NAMED = 4  # up to so many lines of a panel have a name and a colour each; more share one colour
_MAX_TRACES = 2  # tasks whose prediction is drawn
_ALARM_REACH = 4  # scores are drawn up to so many times the range of the inside scores away from them
_LEAST_EXPLAINED = 0.02  # a principal axis that holds less of the variance is not drawn


def plot_diagnostics(diagnostics: Diagnostics, path: str | Path) -> None:
    """Write the figure of ``draw_diagnostics`` to ``path``, whose suffix chooses the format."""
    draw_diagnostics(diagnostics).savefig(path, dpi=150)


def draw_diagnostics(diagnostics: Diagnostics) -> Figure:
    """Draw all diagnostics, on a figure made without pyplot: a panel for each that was measured.

    Needs the ``plots`` extra.
    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    drawings = {
        _draw_pit: True,
        _draw_distances: diagnostics.distance_levels is not None,
        _draw_alarm: diagnostics.outside_tasks is not None,
        _draw_readout: diagnostics.readout_misses is not None,
        _draw_log_scores: True,
        _draw_beliefs: True,
        _draw_prediction: True,
    }
    shown = [draw for draw, is_measured in drawings.items() if is_measured]
    figure = Figure(figsize=(2.0 + 4.5 * math.ceil(len(shown) / 2), 8.8))
    figure.set_layout_engine(ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12))
    head = fill(f"Verdict: {verdict(diagnostics)}", int(8.5 * figure.get_figwidth()))
    figure.suptitle(head, x=0.01, ha="left", fontsize=13, fontweight="bold", color=INK)
    for panel, draw in zip(_two_rows(figure, len(shown)), shown, strict=True):
        draw(panel, diagnostics)
    return figure


def _two_rows(figure: Figure, n_panels: int) -> list[Axes]:
    """Make panels in two rows without a gap; of five, the lower two are wider."""
    rows: Any = figure.subfigures(2, 1)
    upper, lower = rows
    return [*upper.subplots(1, math.ceil(n_panels / 2), squeeze=False).flat, *lower.subplots(1, n_panels // 2).flat]


def _draw_pit(panel: Axes, found: Diagnostics) -> None:
    """Draw histograms of the PIT: flat if calibrated, a hump if too wide, a cup if too narrow."""
    half, most = (_percent(found.coverage(level).mean()) for level in (0.5, 0.9))
    style_panel(panel, f"Calibration: {half} within 50 %, {most} within 90 %")
    edges = np.linspace(0.0, 1.0, 21)
    few, highest = len(found.quantities) <= _MAX_NAMED, 1.0
    for i, (name, ks, color) in enumerate(zip(found.quantities, found.pit_ks(), cycle(COLORS), strict=False)):
        values = found.pit[..., i]
        density, _ = np.histogram(values[~np.isnan(values)], bins=edges, density=True)
        unnamed = {"color": COLORS[0], "label": f"each of {len(found.quantities)} quantities" if i == 0 else None}
        style: dict[str, Any] = {"color": color, "label": f"{name}, KS {ks:.2f}"} if few else unnamed
        highest = max(highest, density.max())
        panel.stairs(density, edges, linewidth=1.8, alpha=1.0 if few else 0.3, **style)
    panel.axhline(1.0, color=GREY, linestyle=(0, (5, 3)), label="calibrated")
    panel.set_ylim(0.0, 1.4 * highest)  # room for the legend
    panel.set_xlim(0.0, 1.0)
    _label(panel, "PIT of the one-step predictive", "density")


def _draw_distances(panel: Axes, found: Diagnostics) -> None:
    """Draw the distribution function of the distances' PIT: the diagonal if calibrated."""
    assert found.distance_levels is not None  # or the panel is left out
    levels = found.distance_levels.reshape(-1, found.distance_levels.shape[-1])
    style_panel(panel, f"Distance of {len(levels)} sets of transitions")
    few = levels.shape[1] <= _MAX_NAMED
    for i, (ks, color) in enumerate(zip(found.distance_ks(), cycle(COLORS), strict=False)):
        name = f"latent {i}" if levels.shape[1] > 1 else "all latents"
        unnamed = {"color": COLORS[0], "label": f"each of {levels.shape[1]} latents" if i == 0 else None}
        style: dict[str, Any] = {"color": color, "label": f"{name}, KS {ks:.2f}"} if few else unnamed
        panel.ecdf(levels[:, i], linewidth=1.8, alpha=1.0 if few else 0.3, **style)
    panel.plot([0.0, 1.0], [0.0, 1.0], color=GREY, linestyle=(0, (5, 3)), label="calibrated")
    panel.set_xlim(-0.02, 1.02)
    panel.set_ylim(0.0, 1.02)
    _label(panel, r"PIT of $\beta_n$", "share of sets below")


def _draw_alarm(panel: Axes, found: Diagnostics) -> None:
    """Draw histograms of the inside and the outside scores; the outermost bars hold all scores beyond them too."""
    from matplotlib.ticker import MaxNLocator

    groups = {"these tasks": found.scores().ravel(), "outside tasks": found.outside_scores().ravel()}
    style_panel(panel, f"Out-of-distribution alarm: AUROC {found.auroc():.3f}")
    every, inside = np.concatenate(list(groups.values())), groups["these tasks"]
    reach = max(_ALARM_REACH * np.ptp(inside), 1e-6)
    low, high = max(every.min(), inside.min() - reach), min(every.max(), inside.max() + reach)
    cut = every.min() < low or every.max() > high
    edges = np.histogram_bin_edges(inside, bins=40, range=(low, high)).tolist()
    for (name, scores), color in zip(groups.items(), COLORS, strict=False):
        panel.hist(np.clip(scores, low, high), bins=edges, color=color, alpha=0.55, label=name)
    panel.yaxis.set_major_locator(MaxNLocator(integer=True))
    _label(panel, f"minus mean log score, nats{' (outer bars: and beyond)' if cut else ''}", "episodes")


def _draw_log_scores(panel: Axes, found: Diagnostics) -> None:
    """Draw the log score at each step: the median episode and the middle half of the episodes."""
    style_panel(panel, f"Log score of held-out transitions: {found.numbers()['log_score']:.2f} nats")
    low, middle, high = np.nanquantile(found.log_scores, (0.25, 0.5, 0.75), axis=(0, 1))
    steps = np.arange(1, len(middle) + 1)
    band = Band(steps, middle, low, high)
    draw_band(panel, band, COLORS[0], "median episode", range_name="middle half of episodes")
    panel.margins(x=0.01)
    _label(panel, "environment step", "nats per transition")


def _draw_readout(panel: Axes, found: Diagnostics) -> None:
    """Draw how far the read-out is off after each step: the median episode and the middle half of the episodes."""
    assert found.readout_misses is not None and found.readout_entries is not None and found.readout_holds is not None
    entries, misses = found.readout_entries, found.readout_misses[:, :, : FIRST_STEPS + 1]
    is_chance = entries[0] == TRUE_TASK
    held = _percent(float(np.nanmean(found.readout_holds[:, :, 1:])))
    style_panel(panel, f"Read-out: {'likeliest task right in' if is_chance else '90 % interval holds'} {held}")
    if len(entries) > _MAX_NAMED:
        entries, misses = np.array(["median entry"]), np.nanmedian(misses, axis=-1, keepdims=True)
    for i, (entry, color) in enumerate(zip(entries, COLORS, strict=False)):
        low, middle, high = np.nanquantile(misses[..., i], (0.25, 0.5, 0.75), axis=(0, 1))
        if is_chance:
            low, middle, high = 1.0 - high, 1.0 - middle, 1.0 - low
        draw_band(panel, Band(np.arange(len(middle)), middle, low, high), color, str(entry))
    panel.set_ylim(bottom=0.0)
    panel.margins(x=0.01)
    _label(panel, "transitions seen", "probability" if is_chance else "miss: median, middle half of episodes")


def _draw_beliefs(panel: Axes, found: Diagnostics) -> None:
    """Draw the posterior means of each episode, from the prior (a cross) to the end (a dot).

    On their two principal axes; along time, where the second holds next to nothing of their variance.
    """
    is_line = found.explained[1] < _LEAST_EXPLAINED
    style_panel(panel, f"Posterior means: {_percent(found.explained[: 1 if is_line else 2].sum())} of their variance")
    few = len(found.tasks) <= len(COLORS)
    colors = list(COLORS) if few else _scale(panel, found.tasks[:, 0], _first_entry(found))
    for title, episodes, color in zip(_titles(found), found.beliefs, colors, strict=False):
        for i, path in enumerate(episodes):
            known = path[~np.isnan(path).any(axis=-1)]
            if is_line:
                known = np.column_stack([np.arange(len(known)), known[:, 0]])[: FIRST_STEPS + 1]
            panel.plot(*known.T, color=color, linewidth=0.8, alpha=0.5)
            label = as_text(title) if few and i == 0 else None
            panel.plot(*known[-1], color=color, marker="o", markersize=6, linestyle="", label=label)
    start = (0.0, found.beliefs[0, 0, 0, 0]) if is_line else found.beliefs[0, 0, 0]
    panel.plot(*start, color=INK, marker="x", markersize=9, linestyle="", label="prior")
    first, second = (f"principal axis {i + 1} ({_percent(share)})" for i, share in enumerate(found.explained))
    _label(panel, *(("transitions seen", first) if is_line else (first, second)))


def _first_entry(found: Diagnostics) -> str:
    """Name the first entry of a task, as the env does if there is a read-out that knows."""
    entries = found.readout_entries
    return "task, first dimension" if entries is None or entries[0] == TRUE_TASK else str(entries[0])


def _scale(panel: Axes, values: Any, about: str) -> list[Any]:
    """Return a colour for each value, and draw the bar that explains the colours."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    mappable = ScalarMappable(Normalize(values.min(), values.max()), colormaps["viridis"])
    bar = panel.get_figure().colorbar(mappable, ax=panel)  # type: ignore[union-attr]  # the panel is on a figure
    bar.set_label(about, fontsize=12, color=INK)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=11, colors=INK)
    return list(mappable.to_rgba(values))


def _draw_prediction(panel: Axes, found: Diagnostics) -> None:
    """Draw what was predicted and what came, in one episode of each of the first tasks."""
    name = str(found.quantities[0])
    style_panel(panel, f"Predicted and real {name}")
    steps = np.arange(1, min(found.real.shape[1], FIRST_STEPS) + 1)
    titles = _titles(found)
    for i, color in zip(range(min(len(found.tasks), _MAX_TRACES)), COLORS, strict=False):
        mean, low, high = found.predicted[:, i, : len(steps)]
        title = titles[i]
        draw_band(panel, Band(steps, mean, low, high), color, f"{title}: mean, 90 %", linewidth=1.2)
        panel.plot(
            steps,
            found.real[i, : len(steps)],
            color=color,
            linestyle="",
            marker=".",
            markersize=4,
            label=as_text(f"{title}: real"),
        )
    panel.margins(x=0.01)
    _label(panel, "environment step", name)


def _titles(found: Diagnostics) -> list[str]:
    names = None if found.names is None else [str(name) for name in found.names]
    return list(map(task_title, task_labels(found.tasks, names)))


def _percent(share: float, digits: int = 0) -> str:
    return f"{100 * share:.{digits}f} %"


def _label(panel: Axes, x: str, y: str) -> None:
    panel.set_xlabel(x, fontsize=12, color=INK)
    panel.set_ylabel(y, fontsize=12, color=INK)
    panel.legend(fontsize=10, frameon=False, labelcolor=INK)
