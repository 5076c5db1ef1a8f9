"""Writes a page of results: the tables and the figures of all recorded runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from sb3_bruno.evaluation.interquartile import Interval, interquartile_mean
from sb3_bruno.files.markdown import as_text
from sb3_bruno.plotting.names import ORACLE
from sb3_bruno.report.figures import draw_page
from sb3_bruno.report.methods import (
    Methods,
    called,
    config_of,
    every_run,
    measure_title,
    methods_of,
    shared_measures,
)
from sb3_bruno.runs.record import RunRecord


def write_page(records: Sequence[RunRecord], out: Path) -> str:
    """Write the tables and the figures of all records to a folder.

    Returns:
        The tables, in Markdown.

    Raises:
        ValueError: if the records were tested over different numbers of steps.
    """
    methods = methods_of(records)
    shown, shared = called(methods)
    page = "\n".join([*by_method(shown), "", *by_run(methods), "", *provenance(methods, shared)]) + "\n"
    (out / "table.md").write_text(page, encoding="utf-8")
    draw_page(shown, out)
    return page


def check_budgets(records: Iterable[RunRecord]) -> None:
    """Refuse runs of one method that differ in environment, length or test tasks: no mean over them makes sense.

    Raises:
        ValueError: if a method has such runs.
    """
    budgets: dict[str, set[str]] = {}
    tasks: dict[str, set[str]] = {}
    for run in records:
        budget = f"{config_of(run)['env_steps']:,} env steps of {config_of(run)['env']}"
        budgets.setdefault(run.method, set()).add(budget)
        tasks.setdefault(run.method, set()).add(" ".join(run.episodes["task"].unique()))
    for method, found in budgets.items():
        if len(found) > 1:
            raise ValueError(f"{method} has runs of {' and of '.join(sorted(found))}: give each a page of its own")
        if len(tasks[method]) > 1:
            raise ValueError(f"{method} has runs that were tested on different tasks: give each a page of its own")


def by_method(methods: Methods) -> list[str]:
    """Write the table with a row per method: interquartile means over the seeds of each measure's mean over tasks."""
    measures = shared_measures(methods)
    parts = {part: tasks for run in every_run(methods) for part, tasks in run.parts().items()}
    told = methods.get(ORACLE, [])
    behind = [f"behind “{ORACLE}”"] if told and len(methods) > 1 else []
    columns = [*map(measure_title, measures), *behind, *(f"{measure_title(measures[-1])}, {part}" for part in parts)]
    lines = _header(["method", "seeds", "env steps", *columns, "lowest episode", "steps to 90 %", "wall minutes"])
    for name, runs in methods.items():
        cells = [name, str(len(runs)), f"{config_of(runs[0])['env_steps']:,}"]
        for measure in measures:
            value, low, high = _over_seeds([run.scores(measure).mean() for run in runs])
            cells.append(f"{value:.1f} ({low:.1f} to {high:.1f})" if len(runs) > 1 else f"{value:.1f}")
        if behind:
            cells.append("" if name == ORACLE else _behind(runs, told, measures[-1]))
        for tasks in parts.values():
            found = [run.scores(measures[-1]).reindex(tasks).mean() for run in runs]
            cells.append("" if np.isnan(found).any() else f"{_over_seeds(found).value:.1f}")
        cells.append(f"{min(run.episodes[measures[-1]].min() for run in runs):.0f}")
        steps = [float(np.mean(list(run.about["steps_to_90"].values()))) for run in runs]
        cells.append(f"{_over_seeds(steps).value:.1f}")
        cells.append(" / ".join(_minutes(run) for run in runs))
        lines.append(_row(cells))
    return lines


def _behind(runs: Sequence[RunRecord], told: Sequence[RunRecord], measure: str) -> str:
    """Say how much less runs have than those that are told the task, on the tasks that the runs were tested on."""
    tasks = runs[0].scores(measure).index
    best = [run.scores(measure).reindex(tasks).mean(skipna=False) for run in told]
    if np.isnan(best).any():
        return ""
    return f"{_over_seeds(best).value - _over_seeds([run.scores(measure).mean() for run in runs]).value:.1f}"


def by_run(methods: Methods) -> list[str]:
    """Write the table with a row per seed: means of the final test, lowest episode, commits of training and test."""
    measures = shared_measures(methods)
    lines = _header(["run", "seed", *map(measure_title, measures), "lowest episode", "trained at", "tested at"])
    for name, runs in methods.items():
        for run in runs:
            means = [f"{run.episodes[measure].mean():.1f}" for measure in measures]
            lowest = f"{run.episodes[measures[-1]].min():.1f}"
            trained = " ".join(map(_short, config_of(run).get("trained_at", []))) or "?"
            tested = _short(run.about["versions"].get("commit", "?"))
            lines.append(_row([name, str(config_of(run).get("seed", "?")), *means, lowest, trained, tested]))
    return lines


def provenance(methods: Methods, shared: Sequence[str] = ()) -> list[str]:
    """Say what the numbers are, what all methods share beyond their configs, and which versions made the numbers."""
    versions = every_run(methods)[0].about["versions"]
    splits = sorted({config_of(run)["split"] for run in every_run(methods) if "split" in config_of(run)})
    tasks = as_text(f"{' and '.join(splits)} tasks")
    names = ("python", "torch", "stable_baselines3", "sb3_contrib", "gymnasium", "mujoco", "zuko")
    return [
        "Final test, with deterministic actions unless the method is called stochastic. "
        f"Each run: mean over the {tasks} that the method was given. "
        "Each method: interquartile mean over seeds (plain mean for three or fewer), with a 95 % bootstrap interval. "
        "The columns of parts and of steps to 90 % hold such means too; the lowest episode is that of all seeds.",
        *([as_text(f"All methods: {', '.join(shared)}.")] if shared else []),
        as_text("Versions: " + ", ".join(f"{name} {versions[name]}" for name in names if name in versions) + "."),
    ]


def _over_seeds(means: Sequence[float]) -> Interval:
    """Return the interquartile mean of the seeds' means, with its interval."""
    return interquartile_mean(np.array(means)[:, None])


def _minutes(run: RunRecord) -> str:
    seconds = config_of(run).get("wall_seconds")
    return "?" if seconds is None else f"{seconds / 60:.0f}"


def _short(commit: str) -> str:
    """Shorten a commit as git does; ``-dirty`` stays."""
    return commit[:7] + ("-dirty" if commit.endswith("-dirty") else "")


def _header(names: Sequence[str]) -> list[str]:
    return [_row(names), "|---" * len(names) + "|"]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(map(as_text, cells))} |"
