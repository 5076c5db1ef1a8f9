"""Writes a page of results: the tables and the figures of all recorded runs."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sb3_bruno.evaluation.band import Band
from sb3_bruno.evaluation.interquartile import Interval, interquartile_mean
from sb3_bruno.evaluation.task_names import ALL_TASKS, pooled_title, task_title
from sb3_bruno.plotting.style import plot_bands
from sb3_bruno.runs.record import RunRecord

Methods = dict[str, list[RunRecord]]
"""The runs of each method, one per seed, by its name."""


def write_page(records: Sequence[RunRecord], out: Path) -> str:
    """Write the tables and the figures of all records to a folder.

    Returns:
        The tables, in Markdown.

    Raises:
        ValueError: if the records were tested over different numbers of steps.
    """
    methods: Methods = {}
    for record in records:
        methods.setdefault(record.method, []).append(record)
    page = "\n".join([*by_method(methods), "", *by_run(methods), "", *provenance(methods)]) + "\n"
    (out / "table.md").write_text(page, encoding="utf-8")
    over_seeds = "Line: mean. Band: lowest to highest seed."
    over_episodes = "Line: mean. Band: lowest to highest episode of all seeds."
    curves, rewards = out / "learning_curves.png", out / "adaptation.png"
    plot_bands(learning_bands(methods), curves, "environment steps of training", "test return", over_seeds)
    clocked = {name: runs for name, runs in methods.items() if all(map(_has_clock, runs))}
    if clocked:
        minutes = out / "wall_time.png"
        plot_bands(learning_bands(clocked, by_clock=True), minutes, "minutes of training", "test return", over_seeds)
    plot_bands(reward_bands(methods), rewards, "environment step", "reward", over_episodes)
    return page


def check_budgets(records: Iterable[RunRecord]) -> None:
    """Refuse runs of one method that differ in environment, length or test tasks: no mean over them makes sense.

    Raises:
        ValueError: if a method has such runs.
    """
    budgets: dict[str, set[str]] = {}
    tasks: dict[str, set[str]] = {}
    for run in records:
        budget = f"{_config(run)['env_steps']:,} env steps of {_config(run)['env']}"
        budgets.setdefault(run.method, set()).add(budget)
        tasks.setdefault(run.method, set()).add(" ".join(run.episodes["task"].unique()))
    for method, found in budgets.items():
        if len(found) > 1:
            raise ValueError(f"{method} has runs of {' and of '.join(sorted(found))}: give each a page of its own")
        if len(tasks[method]) > 1:
            raise ValueError(f"{method} has runs that were tested on different tasks: give each a page of its own")


def by_method(methods: Methods) -> list[str]:
    """Write the table with a row per method: interquartile means over the seeds of each measure's mean over tasks."""
    measures = _measures(methods)
    parts = {part: tasks for run in _all(methods) for part, tasks in run.parts().items()}
    columns = [*map(_column, measures), *(f"{_column(measures[-1])}, {part}" for part in parts)]
    lines = _header(["method", "seeds", "env steps", *columns, "lowest episode", "steps to 90 %", "wall minutes"])
    for name, runs in methods.items():
        cells = [name, str(len(runs)), f"{_config(runs[0])['env_steps']:,}"]
        for measure in measures:
            value, low, high = _over_seeds([run.scores(measure).mean() for run in runs])
            cells.append(f"{value:.1f} ({low:.1f} to {high:.1f})" if len(runs) > 1 else f"{value:.1f}")
        for tasks in parts.values():
            found = [run.scores(measures[-1]).reindex(tasks).mean() for run in runs]
            cells.append("" if np.isnan(found).any() else f"{_over_seeds(found).value:.1f}")
        cells.append(f"{min(run.episodes[measures[-1]].min() for run in runs):.0f}")
        steps = [float(np.mean(list(run.about["steps_to_90"].values()))) for run in runs]
        cells.append(f"{_over_seeds(steps).value:.1f}")
        cells.append(" / ".join(_minutes(run) for run in runs))
        lines.append(_row(cells))
    return lines


def by_run(methods: Methods) -> list[str]:
    """Write the table with a row per seed: means of the final test, lowest episode, commits of training and test."""
    measures = _measures(methods)
    lines = _header(["run", "seed", *map(_column, measures), "lowest episode", "trained at", "tested at"])
    for name, runs in methods.items():
        for run in runs:
            means = [f"{run.episodes[measure].mean():.1f}" for measure in measures]
            lowest = f"{run.episodes[measures[-1]].min():.1f}"
            trained = " ".join(map(_short, _config(run).get("trained_at", []))) or "?"
            tested = _short(run.about["versions"].get("commit", "?"))
            lines.append(_row([name, str(_config(run).get("seed", "?")), *means, lowest, trained, tested]))
    return lines


def provenance(methods: Methods) -> list[str]:
    """Say what the numbers are, and which versions made them."""
    versions = _all(methods)[0].about["versions"]
    splits = sorted({_config(run)["split"] for run in _all(methods) if "split" in _config(run)})
    tasks = _as_text(f"{' and '.join(splits)} tasks")
    names = ("python", "torch", "stable_baselines3", "sb3_contrib", "gymnasium", "mujoco", "zuko")
    return [
        "Final test, with deterministic actions unless the method is called stochastic. "
        f"Each run: mean over the {tasks} that the method was given. "
        "Each method: interquartile mean over seeds (plain mean for three or fewer), with a 95 % bootstrap interval. "
        "The columns of parts and of steps to 90 % hold such means too; the lowest episode is that of all seeds.",
        _as_text("Versions: " + ", ".join(f"{name} {versions[name]}" for name in names if name in versions) + "."),
    ]


def _over_seeds(means: Sequence[float]) -> Interval:
    """Return the interquartile mean of the seeds' means, with its interval."""
    return interquartile_mean(np.array(means)[:, None])


def learning_bands(methods: Methods, *, by_clock: bool = False) -> dict[str, dict[str, Band]]:
    """Compute the test return while training, by panel and method: the mean over the seeds, and their range.

    Args:
        methods: the runs of each method.
        by_clock: whether x counts minutes of training, averaged over the seeds; if not, it counts environment steps.
    """
    panels: dict[str, dict[str, Band]] = {}
    tasks = _few_tasks(methods)
    for task in tasks or [""]:
        for name, runs in methods.items():
            curves = [run.learning if not task else run.learning[run.learning["task"] == task] for run in runs]
            if any(curve.empty for curve in curves):
                continue  # this method has other tasks
            returns = _means(curves, "return").dropna()  # as far as the shortest run goes
            x = returns.index.to_numpy()
            if by_clock:
                x = _means(curves, "seconds").loc[returns.index].mean(axis=1).to_numpy() / 60
            panels.setdefault(_title(task, methods), {})[name] = Band.of(x, returns.to_numpy().T)
    return panels


def _means(curves: Sequence[pd.DataFrame], column: str) -> pd.DataFrame:
    """Average a column over the episodes of each evaluation: a row per evaluation, a column per run."""
    return pd.concat([curve.groupby("timesteps")[column].mean() for curve in curves], axis=1)


def reward_bands(methods: Methods) -> dict[str, dict[str, Band]]:
    """Compute the reward at each step of the final test, by panel and method: mean, lowest and highest episode."""
    panels: dict[str, dict[str, Band]] = {}
    for name, runs in methods.items():
        pooled = pd.concat([run.rewards for run in runs]).groupby(["task", "step"], sort=False)
        bands = pooled.agg({"mean": "mean", "low": "min", "high": "max"})
        for task, band in bands.groupby(level="task", sort=False):
            x = band.index.get_level_values("step").to_numpy()
            lines = (band[column].to_numpy() for column in ("mean", "low", "high"))
            panels.setdefault(_title("" if task == ALL_TASKS else str(task), methods), {})[name] = Band(x, *lines)
    return panels


def _few_tasks(methods: Methods) -> Sequence[str]:
    """Return the tasks of all runs together; none if some run has so many that its record pools them."""
    tasks = dict.fromkeys(task for run in _all(methods) for task in run.rewards["task"].unique())
    return [] if ALL_TASKS in tasks else list(tasks)


def _title(task: str, methods: Methods) -> str:
    """Return the title of a task's panel, or of the panel for all tasks if ``task`` is empty."""
    return task_title(task) if task else pooled_title(max(run.episodes["task"].nunique() for run in _all(methods)))


def _has_clock(run: RunRecord) -> bool:
    return "seconds" in run.learning and bool(run.learning["seconds"].notna().all())


def _all(methods: Methods) -> list[RunRecord]:
    return [run for runs in methods.values() for run in runs]


def _config(run: RunRecord) -> Mapping[str, Any]:
    config: Mapping[str, Any] = run.about["config"]
    return config


def _minutes(run: RunRecord) -> str:
    seconds = _config(run).get("wall_seconds")
    return "?" if seconds is None else f"{seconds / 60:.0f}"


def _measures(methods: Methods) -> list[str]:
    """Return the measures that all runs have, the longest horizon last."""
    first, *others = _all(methods)
    measures = [measure for measure in first.measures if all(measure in other.measures for other in others)]
    if not measures:
        raise ValueError("the runs were tested over different numbers of steps: evaluate all with the same --steps")
    return measures


def _short(commit: str) -> str:
    """Shorten a commit as git does; ``-dirty`` stays."""
    return commit[:7] + ("-dirty" if commit.endswith("-dirty") else "")


def _column(measure: str) -> str:
    """Return the head of a measure's column: "1,000 steps" for return_1000, "episode 2" for episode_2."""
    if measure == "success_percent":
        return "success, %"
    kind, number = measure.split("_")
    return f"{int(number):,} steps" if kind == "return" else f"episode {number}"


def _header(names: Sequence[str]) -> list[str]:
    return [_row(names), "|---" * len(names) + "|"]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(map(_as_text, cells))} |"


def _as_text(said: str) -> str:
    """Write what a record says so that Markdown shows it as it is, on one line."""
    return html.escape(" ".join(said.split()), quote=False).replace("|", "\\|")
