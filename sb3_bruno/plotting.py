"""The paper's figures: test returns while training (1 and 2), rewards while acting (3 and 4).

Draws on figures of its own and leaves matplotlib's global state, backend and style, alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.adaptation_result import FEW_TASKS, AdaptationResult, task_label
from sb3_bruno.eval_callback import LearningCurve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.floating[Any]]

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")  # Okabe and Ito: for all eyes
INK = "#404040"
WIDEST = 44  # characters of the legend that a panel has room for above it


class Band(NamedTuple):
    """A line and the range around it: ``x``, and the mean, lowest and highest value there, ``(n,)`` each."""

    x: NDArray[np.int64] | Floats
    mean: Floats
    low: Floats
    high: Floats


def plot_adaptation(results: Mapping[str, AdaptationResult], path: str | Path) -> None:
    """Draw the reward at each environment step: the mean over episodes, and the range.

    Up to four tasks get a panel each, if all results share them; otherwise they are pooled. A panel's title tells
    the mean returns, in the order of the legend.

    Args:
        results: by the name to show in the legend.
        path: the image to write; its suffix chooses the format.

    Raises:
        ValueError: if ``results`` is empty.
    """
    if not results:
        raise ValueError("results is empty: give at least one AdaptationResult, by the name to show.")
    tasks = next(iter(results.values())).tasks
    shared = all(np.array_equal(result.tasks, tasks) for result in results.values())
    pooled = not shared or len(tasks) > FEW_TASKS
    panels: dict[str, dict[str, Band]] = {}
    for number, title in enumerate([_pooled_title(tasks)] if pooled else map(task_title, tasks)):
        rows = slice(None) if pooled else slice(number, number + 1)
        returns = ", ".join(f"{result.mean_return()[rows].mean():.1f}" for result in results.values())
        panels[f"{title}: return {returns}"] = {name: adaptation_band(one, rows) for name, one in results.items()}
    plot_bands(panels, path, "environment step", "reward", "Line: mean. Band: lowest to highest episode.")


def plot_learning_curves(
    curves: Mapping[str, LearningCurve | Sequence[LearningCurve]],
    path: str | Path,
    *,
    oracle: float | Mapping[str, float] | None = None,
) -> None:
    """Draw the test return against the environment steps of training.

    The line is the mean over runs; the band the range of the runs' means or, when no method has several runs,
    the range of episodes. Up to four tasks get a panel each; more are pooled.

    Args:
        curves: the runs of each method, one per seed, by the name to show in the legend.
        path: the image to write; its suffix chooses the format.
        oracle: the return to compare with, or one for each task, by ``task_label``; a dashed line.

    Raises:
        ValueError: if ``curves`` is empty, the runs of a method were evaluated at different steps, or
            ``oracle`` lacks a task.
    """
    methods = {name: [runs] if isinstance(runs, LearningCurve) else list(runs) for name, runs in curves.items()}
    if not methods or not all(methods.values()):
        raise ValueError("curves is empty, or a method in it: give at least one LearningCurve for each name.")
    every_task = [run.tasks.reshape(-1, run.tasks.shape[-1]) for runs in methods.values() for run in runs]
    tasks = np.unique(np.concatenate(every_task), axis=0)  # (n_tasks, task_dim)
    pooled = len(tasks) > FEW_TASKS
    several = max(len(runs) for runs in methods.values()) > 1
    panels: dict[str, dict[str, Band]] = {}
    levels: dict[str, float] = {}
    for task in [None] if pooled else tasks:
        title = _pooled_title(tasks) if task is None else task_title(task)
        panels[title] = {name: learning_band(name, runs, task, over_runs=several) for name, runs in methods.items()}
        if oracle is not None:
            levels[title] = _oracle_return(oracle, task)
    note = f"Line: mean. Band: lowest to highest {'run' if several else 'episode'}."
    plot_bands(panels, path, "environment steps of training", "test return", note, levels)


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
        panels: by title, the bands by the name to show in the legend.
        path: the image to write; its suffix chooses the format.
        x: name of the horizontal axis.
        y: name of the vertical axis.
        note: what line and band are, written below.
        levels: by title, the oracle's return, a dashed line.
    """
    names = dict.fromkeys(name for bands in panels.values() for name in bands)
    colors = dict(zip(names, cycle(COLORS), strict=False))  # one name, one colour, in whichever panels it is
    figure, axes = _panels(list(panels))
    for (title, bands), panel in zip(panels.items(), axes, strict=True):
        for name, band in bands.items():
            _draw(panel, band, name, colors[name])
        if levels:
            panel.axhline(levels[title], color=INK, linestyle=(0, (5, 3)), label="oracle")
    _label(figure, axes, x, y, note)
    _add_legend(figure, axes)
    figure.savefig(path, dpi=150)


def adaptation_band(result: AdaptationResult, rows: slice = slice(None)) -> Band:
    """The rewards of the tasks in ``rows``, pooled; ``x`` counts steps from 1. Ended episodes drop out."""
    episodes = result.rewards[rows].reshape(-1, result.horizon)
    return _band(np.arange(1, result.horizon + 1), episodes, episodes)


def learning_band(
    name: str, runs: Sequence[LearningCurve], task: Floats | None = None, *, over_runs: bool = True
) -> Band:
    """The returns on one ``task``, ``(task_dim,)``, or on all; as far as the shortest run goes.

    The range is that of the runs' means, or of the episodes if not ``over_runs``.

    Raises:
        ValueError: if the runs of the method called ``name`` were evaluated at different steps.
    """
    n = min(len(run.timesteps) for run in runs)
    timesteps = runs[0].timesteps[:n]
    if not all(np.array_equal(run.timesteps[:n], timesteps) for run in runs):
        raise ValueError(f"the runs of {name!r} were evaluated at different steps: give runs of one eval_freq.")
    returns = [_returns_of_task(run, task)[:n].T for run in runs]  # (n_episodes, n) each
    means = np.stack([_mean(run) for run in returns])  # (n_runs, n)
    return _band(timesteps, means, means if over_runs else np.concatenate(returns))


def _returns_of_task(run: LearningCurve, task: Floats | None) -> Floats:
    """The returns, ``(n_evals, n_episodes)``, NaN where an episode had another task."""
    return run.returns if task is None else np.where((run.tasks == task).all(axis=-1), run.returns, np.nan)


def _band(x: NDArray[np.int64], values: Floats, spread: Floats) -> Band:
    """The mean of ``values`` and the range of ``spread``, ``(n_samples, n)`` each; NaN is no sample."""
    return Band(x, _mean(values), np.fmin.reduce(spread, axis=0), np.fmax.reduce(spread, axis=0))


def _mean(values: Floats) -> Floats:
    """The mean over the first axis of what is not NaN; NaN, without a warning, where nothing is left."""
    with np.errstate(invalid="ignore"):
        means: Floats = np.nansum(values, axis=0, dtype=np.float64) / (~np.isnan(values)).sum(axis=0)
    return means


def _oracle_return(oracle: float | Mapping[str, float], task: Floats | None) -> float:
    """The oracle's return on ``task``, or over all tasks without one."""
    if not isinstance(oracle, Mapping):
        return oracle
    if task is None:
        return float(np.mean(list(oracle.values())))
    if task_label(task) not in oracle:
        raise ValueError(f"oracle has {sorted(oracle)} and lacks task {task_label(task)!r}: add its return.")
    return oracle[task_label(task)]


def task_title(task: Floats) -> str:
    """``task 0.5``, or ``task (1, 0)``."""
    values = task_label(task).replace("_", ", ")
    return f"task {values}" if len(task) == 1 else f"task ({values})"


def _pooled_title(tasks: Floats) -> str:
    return f"{len(tasks)} tasks"


def _panels(titles: Sequence[str]) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each title, side by side, on one scale."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1.6 + 4.4 * len(titles), 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(titles), sharey=True, squeeze=False)[0])
    for panel, title in zip(panels, titles, strict=True):
        style_panel(panel, title)
    return figure, panels


def style_panel(panel: Axes, title: str) -> None:
    """Give a panel its title and the look of all figures here."""
    panel.set_title(title, loc="left", fontsize=12, color=INK)
    panel.spines[["top", "right"]].set_visible(False)
    panel.spines[["left", "bottom"]].set_color(INK)
    panel.tick_params(labelsize=11, colors=INK)
    panel.grid(color="#E6E6E6", linewidth=0.8)
    panel.set_axisbelow(True)


def _draw(panel: Axes, band: Band, name: str, color: str) -> None:
    """Draw the line and its range; a lone point, which makes no line, as a dot."""
    panel.fill_between(band.x, band.low, band.high, color=color, alpha=0.18, linewidth=0)
    marker = "o" if len(band.x) == 1 else ""
    panel.plot(band.x, band.mean, color=color, linewidth=1.8, marker=marker, label=name)


def _label(figure: Figure, panels: Sequence[Axes], x: str, y: str, note: str) -> None:
    """Name the axes, and say below what line and band are."""
    from matplotlib.ticker import EngFormatter

    for panel in panels:
        panel.set_xlabel(x, fontsize=12, color=INK)
        panel.xaxis.set_major_formatter(EngFormatter(sep=""))  # 200k, 1.5M
        panel.margins(x=0.01)
    panels[0].set_ylabel(y, fontsize=12, color=INK)
    figure.supxlabel(note, fontsize=9.5, color="#7A7A7A")


def _add_legend(figure: Figure, panels: Sequence[Axes]) -> None:
    """Put one legend of all panels above them, where it hides no line, and let the figure grow by it."""
    lines = {name: line for panel in panels for line, name in zip(*panel.get_legend_handles_labels(), strict=True)}
    room = WIDEST * len(panels)
    names = [fill(name, room, break_on_hyphens=False) for name in lines]
    n_columns = max(room // (max(map(len, lines)) + 8), 1)  # a sample of a line is as wide as some eight characters
    n_rows = max(sum(name.count("\n") + 1 for name in names[first::n_columns]) for first in range(n_columns))
    figure.set_figheight(figure.get_figheight() + 0.23 * n_rows)  # inches
    handles = list(lines.values())
    look = {"fontsize": 11, "frameon": False, "labelcolor": INK}
    figure.legend(handles, names, loc="outside upper left", ncols=n_columns, **look)
