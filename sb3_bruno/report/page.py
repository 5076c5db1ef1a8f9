"""A page of results: the table and the figures of all runs that were recorded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sb3_bruno.evaluation.interquartile import Interval, interquartile_mean
from sb3_bruno.plotting.style import Band, plot_bands, task_title
from sb3_bruno.runs.record import RunRecord

Methods = dict[str, list[RunRecord]]


def write_page(records: Sequence[RunRecord], out: Path) -> str:
    """Write the table and the figures of all records to a folder.

    :return: the table, in Markdown
    :raises ValueError: if the records were tested over different numbers of steps
    """
    methods: Methods = {}
    for record in records:
        methods.setdefault(record.method, []).append(record)
    page = "\n".join([*by_method(methods), "", *by_run(methods), "", *provenance(methods)]) + "\n"
    (out / "table.md").write_text(page, encoding="utf-8")
    seeds, episodes = ("Line: mean. Band: lowest to highest " + one for one in ("seed.", "episode of all seeds."))
    curves, rewards = out / "learning_curves.png", out / "adaptation.png"
    plot_bands(learning_bands(methods), curves, "environment steps of training", "test return", seeds)
    clocked = {name: runs for name, runs in methods.items() if all(map(_knows_its_clock, runs))}
    if clocked:
        minutes = out / "wall_time.png"
        plot_bands(learning_bands(clocked, by_clock=True), minutes, "minutes of training", "test return", seeds)
    plot_bands(reward_bands(methods), rewards, "environment step", "reward", episodes)
    return page


def check_budgets(records: Iterable[RunRecord]) -> None:
    """Refuse a mean over runs of one method that differ in env, length or the tasks of their test."""
    budgets: dict[str, set[str]] = {}
    tasks: dict[str, set[str]] = {}
    for run in records:
        budget = f"{_config(run)['env_steps']:,} env steps of {_config(run)['env']}"
        budgets.setdefault(run.method, set()).add(budget)
        tasks.setdefault(run.method, set()).add(" ".join(run.episodes["task"].unique()))
    for method, of_method in budgets.items():
        if len(of_method) > 1:
            raise ValueError(f"{method} has runs of {' and of '.join(sorted(of_method))}: give each a page of its own")
        if len(tasks[method]) > 1:
            raise ValueError(f"{method} has runs that were tested on different tasks: give each a page of its own")


def by_method(methods: Methods) -> list[str]:
    """The interquartile mean over seeds of each measure's mean over the tasks; the lowest episode of all beside it."""
    measures = _measures(methods)
    parts = {part: tasks for run in _all(methods) for part, tasks in run.parts().items()}
    columns = [_column(one) for one in measures] + [f"{_column(measures[-1])}, {part}" for part in parts]
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
    """One row per seed: the mean return of the final test, its lowest episode, and the commits of training and test."""
    measures = _measures(methods)
    lines = _header(["run", "seed", *map(_column, measures), "lowest episode", "trained at", "tested at"])
    for name, runs in methods.items():
        for run in runs:
            means = [f"{run.episodes[measure].mean():.1f}" for measure in measures]
            lowest = f"{run.episodes[measures[-1]].min():.1f}"
            trained = " ".join(map(_short, _config(run).get("trained_at", []))) or "?"
            tested = _short(run.about["versions"].get("commit", "?"))
            lines.append(_row([name, str(_config(run)["seed"]), *means, lowest, trained, tested]))
    return lines


def provenance(methods: Methods) -> list[str]:
    """What the numbers are, and the versions that made them."""
    versions = _all(methods)[0].about["versions"]
    splits = sorted({_config(run)["split"] for run in _all(methods) if "split" in _config(run)})
    tasks = " and ".join(splits) + " tasks" if splits else "tasks"
    names = ("python", "torch", "stable_baselines3", "sb3_contrib", "gymnasium", "mujoco", "zuko")
    return [
        f"Final test: deterministic unless called stochastic, mean over the {tasks} that a method was given; by method "
        "the interquartile mean over seeds of that, which is the mean where they are three or fewer, with the 95 % "
        "interval of the bootstrap over seeds; so are parts and steps, and the lowest episode is that of all seeds.",
        "Versions: " + ", ".join(f"{name} {versions[name]}" for name in names if name in versions) + ".",
    ]


def _over_seeds(means: Sequence[float]) -> Interval:
    return interquartile_mean(np.array(means)[:, None])


def learning_bands(methods: Methods, *, by_clock: bool = False) -> dict[str, dict[str, Band]]:
    """By panel and method, the test return while training: the mean over seeds, and their range.

    By environment steps, or by the minutes that the seeds took for them, in the mean.
    """
    panels: dict[str, dict[str, Band]] = {}
    tasks = _few_tasks(methods)
    for task in tasks or [""]:
        for name, runs in methods.items():
            curves = [run.learning if not task else run.learning[run.learning["task"] == task] for run in runs]
            if any(one.empty for one in curves):
                continue  # a method of other tasks
            means = pd.concat([one.groupby("timesteps")["return"].mean() for one in curves], axis=1).dropna()
            band = _band(means)
            if by_clock:
                seconds = pd.concat([one.groupby("timesteps")["seconds"].mean() for one in curves], axis=1)
                band = band._replace(x=seconds.loc[means.index].mean(axis=1).to_numpy() / 60)
            panels.setdefault(_title(task, methods), {})[name] = band
    return panels


def reward_bands(methods: Methods) -> dict[str, dict[str, Band]]:
    """By panel and method, the reward at each step of the final test: the mean, the lowest and the highest episode."""
    panels: dict[str, dict[str, Band]] = {}
    for name, runs in methods.items():
        pooled = pd.concat([run.rewards for run in runs]).groupby(["task", "step"], sort=False)
        bands = pooled.agg({"mean": "mean", "low": "min", "high": "max"})
        for task, band in bands.groupby(level="task", sort=False):
            x = band.index.get_level_values("step").to_numpy()
            lines = (band[column].to_numpy() for column in ("mean", "low", "high"))
            panels.setdefault(_title("" if task == "all" else str(task), methods), {})[name] = Band(x, *lines)
    return panels


def _band(means: pd.DataFrame) -> Band:
    """means: a row per x, a column per seed."""
    return Band(
        means.index.to_numpy(), *(one.to_numpy() for one in (means.mean(axis=1), means.min(axis=1), means.max(axis=1)))
    )


def _few_tasks(methods: Methods) -> Sequence[str]:
    """The tasks of all runs together, if each has few enough for a panel and a column each."""
    tasks = dict.fromkeys(task for run in _all(methods) for task in run.rewards["task"].unique())
    return [] if "all" in tasks else list(tasks)


def _title(task: str, methods: Methods) -> str:
    if task:
        return task_title(np.array(task.split("_"), dtype=np.float64))
    return f"{max(run.episodes['task'].nunique() for run in _all(methods))} tasks"


def _knows_its_clock(run: RunRecord) -> bool:
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
    """What all runs measured, the longest horizon last."""
    first, *others = _all(methods)
    measures = [one for one in first.measures if all(one in other.measures for other in others)]
    if not measures:
        raise ValueError("the runs were tested over different numbers of steps: evaluate all with the same --steps")
    return measures


def _short(commit: str) -> str:
    """As git shortens it; a clone with changes keeps its mark."""
    return commit[:7] + ("-dirty" if commit.endswith("-dirty") else "")


def _column(measure: str) -> str:
    """return_1000 is "1,000 steps", episode_2 is "episode 2"."""
    kind, number = measure.split("_")
    return f"{int(number):,} steps" if kind == "return" else f"episode {number}"


def _header(names: Sequence[str]) -> list[str]:
    return [_row(names), "|---" * len(names) + "|"]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
