"""Draws the figures of a results page: while training, while acting, method by method, and task by task."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from sb3_bruno.evaluation.band import Band
from sb3_bruno.evaluation.interquartile import interquartile_mean
from sb3_bruno.plotting.dots import Dots, plot_dots
from sb3_bruno.plotting.names import ORACLE
from sb3_bruno.plotting.style import FIRST_STEPS, plot_bands
from sb3_bruno.report.methods import (
    Methods,
    config_of,
    every_run,
    few_tasks,
    measure_title,
    panel_title,
    shared_measures,
)
from sb3_bruno.report.task_axis import task_axis, task_bands
from sb3_bruno.runs.record import RunRecord
from sb3_bruno.task_names import ALL_TASKS

Panels = dict[str, dict[str, Band]]
"""For each title, the bands by the name of their method."""

_FAR = 5.0  # times as much as the others


def draw_page(methods: Methods, out: Path) -> None:
    """Draw all figures that the records allow, into a page's folder. Those of an earlier page go."""
    for old in out.glob("*.png"):
        if old.stem in _FIGURES:
            old.unlink()
    for name, draw in _FIGURES.items():
        draw(methods, out / f"{name}.png")


def _draw_learning(methods: Methods, path: Path) -> None:
    plot_bands(learning_bands(methods), path, "environment steps of training", "test return", _note(methods))


def _draw_wall_time(methods: Methods, path: Path) -> None:
    clocked = {name: runs for name, runs in methods.items() if all(map(_has_clock, runs))}
    if clocked:
        plot_bands(learning_bands(clocked, by_clock=True), path, "minutes of training", "test return", _note(methods))


def _draw_rewards(methods: Methods, path: Path) -> None:
    panels, borders = reward_bands(methods), _borders(methods)
    plot_bands(panels, path, "environment step", "reward", _note(methods), first=FIRST_STEPS, borders=borders)


def _draw_regret(methods: Methods, path: Path) -> None:
    """Draw the reward that a method has earned less than the one that is told the task, added up over the steps."""
    panels = regret_bands(methods)
    if panels:
        y = f"reward behind\n“{ORACLE}”, summed"
        note = f"{_note(methods)} A line that leaves the picture goes on."
        top, borders = _highest(panels), _borders(methods)
        plot_bands(panels, path, "environment step", y, note, borders=borders, highest=top)


def _draw_methods(methods: Methods, path: Path) -> None:
    if len(methods) == 1:
        return
    measure = shared_measures(methods)[-1]
    rows = {}
    for name, runs in methods.items():
        means = np.array([float(run.scores(measure).mean()) for run in runs])
        rows[name] = Dots(means, *interquartile_mean(means[:, None]))
    note = "Small dots: seeds. Large dot and line: interquartile mean (mean of three or fewer), 95 % interval."
    plot_dots(rows, path, f"test return, {measure_title(measure)}", note)


def _draw_tasks(methods: Methods, path: Path) -> None:
    axis = task_axis(methods)
    if axis is not None:
        measure = shared_measures(methods)[-1]
        title, bands = f"final test, {measure_title(measure)}", task_bands(methods, measure, axis)
        is_positive = all((band.low > 0).all() for band in bands.values())
        plot_bands({title: bands}, path, axis.x, axis.y, _note(methods), log=axis.is_miss and is_positive)


_FIGURES: dict[str, Callable[[Methods, Path], None]] = {
    "learning_curves": _draw_learning,
    "wall_time": _draw_wall_time,
    "adaptation": _draw_rewards,
    "regret": _draw_regret,
    "methods": _draw_methods,
    "tasks": _draw_tasks,
}


def learning_bands(methods: Methods, *, by_clock: bool = False) -> Panels:
    """Compute the test return while training, by panel and method: the mean over the seeds, and their middle half.

    Args:
        methods: the runs of each method.
        by_clock: whether x counts minutes of training, averaged over the seeds; if not, it counts environment steps.
    """
    panels: Panels = {}
    for task in few_tasks(methods) or [""]:
        for name, runs in methods.items():
            curves = [run.learning if not task else run.learning[run.learning["task"] == task] for run in runs]
            if any(curve.empty for curve in curves):
                continue  # this method has other tasks
            returns = _means(curves, "return").dropna()  # as far as the shortest run goes
            x = returns.index.to_numpy()
            if by_clock:
                x = _means(curves, "seconds").loc[returns.index].mean(axis=1).to_numpy() / 60
            panels.setdefault(panel_title(task, methods), {})[name] = Band.of(x, returns.to_numpy().T)
    return panels


def _means(curves: Sequence[pd.DataFrame], column: str) -> pd.DataFrame:
    """Average a column over the episodes of each evaluation: a row per evaluation, a column per run."""
    return pd.concat([curve.groupby("timesteps")[column].mean() for curve in curves], axis=1)


def reward_bands(methods: Methods) -> Panels:
    """Compute the reward at each step of the final test, by panel and method, over the seeds."""
    return {
        title: {name: Band.of(rewards.index.to_numpy(), rewards.to_numpy().T) for name, rewards in of_task.items()}
        for title, of_task in _rewards(methods).items()
    }


def regret_bands(methods: Methods) -> Panels:
    """Add up what the methods earn less than the one that is told the task; nothing if there is none, or no other."""
    panels: Panels = {}
    for title, of_task in _rewards(methods).items():
        told = of_task.pop(ORACLE, None)
        for name, rewards in of_task.items() if told is not None else ():
            behind = -rewards.sub(told.mean(axis=1), axis=0).dropna().cumsum()
            panels.setdefault(title, {})[name] = Band.of(behind.index.to_numpy(), behind.to_numpy().T)
    return panels


def _highest(panels: Panels) -> float | None:
    """Choose where a figure ends above, so that one method far off the others does not squeeze them."""
    names = {name for bands in panels.values() for name in bands}
    tops = sorted(
        max(float(np.nanmax(bands[name].high)) for bands in panels.values() if name in bands) for name in names
    )
    is_far = len(tops) > 1 and tops[-1] > _FAR * max(tops[-2], 0.0)
    return 1.2 * tops[-2] if is_far and tops[-2] > 0 else None


def _rewards(methods: Methods) -> dict[str, dict[str, pd.DataFrame]]:
    """Tabulate the mean reward at each step of the final test, by panel and method: a row per step, a column per run.

    A method that has other tasks is left out.
    """
    tables: dict[str, dict[str, pd.DataFrame]] = {}
    for task in few_tasks(methods) or [ALL_TASKS]:
        for name, runs in methods.items():
            curves = [run.rewards[run.rewards["task"] == task].set_index("step")["mean"] for run in runs]
            if not any(curve.empty for curve in curves):
                title = panel_title("" if task == ALL_TASKS else task, methods)
                tables.setdefault(title, {})[name] = pd.concat(curves, axis=1)
    return tables


def _note(methods: Methods) -> str:
    """Say what lines and bands are."""
    if all(len(runs) == 1 for runs in methods.values()):
        return "One seed."
    return "Line: mean. Band: middle half of the seeds."


def _borders(methods: Methods) -> list[float]:
    """Tell between which steps episodes of a trial end; nowhere if the methods' trials differ, or there are none."""
    runs = every_run(methods)
    trials = {(config_of(run).get("n_inner_episodes", 1), int(run.rewards["step"].max())) for run in runs}
    n_inner, horizon = trials.pop()
    return [] if trials else [horizon * i / n_inner + 0.5 for i in range(1, n_inner)]


def _has_clock(run: RunRecord) -> bool:
    return "seconds" in run.learning and bool(run.learning["seconds"].notna().all())
