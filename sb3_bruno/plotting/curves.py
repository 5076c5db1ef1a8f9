"""Draws the paper's figures: test returns while training (its 1 and 2), rewards while acting (its 3 and 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.band import Band
from sb3_bruno.evaluation.eval_callback import LearningCurve
from sb3_bruno.evaluation.floats import Floats, mean_of_known
from sb3_bruno.plotting.style import FIRST_STEPS, plot_bands
from sb3_bruno.task_names import FEW_TASKS, pooled_title, task_label, task_labels, task_title


def plot_adaptation(results: Mapping[str, AdaptationResult], path: str | Path) -> None:
    """Draw the reward at each environment step, the first 60 large: the mean over the episodes, and their middle half.

    Up to four tasks get a panel each, if all results have the same tasks; otherwise the tasks are pooled. A panel's
    title shows the mean returns, in the order of ``results``. Lines divide the episodes of a trial.

    Args:
        results: by the name to show in the legend.
        path: the image to write; its suffix chooses the format.

    Raises:
        ValueError: if ``results`` is empty.
    """
    if not results:
        raise ValueError("results is empty: give at least one AdaptationResult, by the name to show.")
    first = next(iter(results.values()))
    tasks = first.tasks
    shared = all(np.array_equal(result.tasks, tasks) for result in results.values())
    pooled = not shared or len(tasks) > FEW_TASKS
    panels: dict[str, dict[str, Band]] = {}
    for number, title in enumerate([pooled_title(len(tasks))] if pooled else map(task_title, first.labels)):
        rows = slice(None) if pooled else slice(number, number + 1)
        returns = ", ".join(f"{result.mean_return()[rows].mean():.1f}" for result in results.values())
        bands = {name: adaptation_band(result, rows) for name, result in results.items()}
        panels[f"{title}: return {returns}"] = bands
    n_inner = first.config.get("n_inner_episodes", 1)
    borders = [first.horizon * i / n_inner + 0.5 for i in range(1, n_inner)]
    note = "Line: mean. Band: middle half of the episodes."
    plot_bands(panels, path, "environment step", "reward", note, first=FIRST_STEPS, borders=borders)


def plot_learning_curves(
    curves: Mapping[str, LearningCurve | Sequence[LearningCurve]],
    path: str | Path,
    *,
    oracle: float | Mapping[str, float] | None = None,
) -> None:
    """Draw the test return against the environment steps of training.

    The line is the mean over the runs. The band is the middle half of the runs' means, or of the episodes if no method
    has several runs. Up to four tasks get a panel each; more are pooled.

    Args:
        curves: the runs of each method, one per seed, by the name to show in the legend.
        path: the image to write; its suffix chooses the format.
        oracle: the return of an agent that is told the task, drawn as a dashed line; or its return on each task, by
            ``task_label``.

    Raises:
        ValueError: if ``curves`` is empty, the runs of a method were evaluated at different steps, or ``oracle`` lacks
            a task.
    """
    methods = {name: [runs] if isinstance(runs, LearningCurve) else list(runs) for name, runs in curves.items()}
    if not methods or not all(methods.values()):
        raise ValueError("curves is empty, or a method in it: give at least one LearningCurve for each name.")
    every_task = [run.tasks.reshape(-1, run.tasks.shape[-1]) for runs in methods.values() for run in runs]
    every_name = np.concatenate([run.called().ravel() for runs in methods.values() for run in runs])
    tasks, first = np.unique(np.concatenate(every_task), axis=0, return_index=True)  # (n_tasks, task_dim)
    titles = [task_title(label) for label in task_labels(tasks, every_name[first].tolist())]
    pooled = len(tasks) > FEW_TASKS
    several = max(len(runs) for runs in methods.values()) > 1
    panels: dict[str, dict[str, Band]] = {}
    levels: dict[str, float] = {}
    for task, title in [(None, pooled_title(len(tasks)))] if pooled else zip(tasks, titles, strict=True):
        panels[title] = {name: learning_band(name, runs, task, over_runs=several) for name, runs in methods.items()}
        if oracle is not None:
            levels[title] = _oracle_return(oracle, task)
    note = f"Line: mean. Band: middle half of the {'runs' if several else 'episodes'}."
    plot_bands(panels, path, "environment steps of training", "test return", note, levels)


def adaptation_band(result: AdaptationResult, rows: slice = slice(None)) -> Band:
    """Pool the rewards of the tasks in ``rows``; ``x`` counts steps from 1. Episodes that have ended drop out."""
    return Band.of(np.arange(1, result.horizon + 1), result.rewards[rows].reshape(-1, result.horizon))


def learning_band(
    name: str, runs: Sequence[LearningCurve], task: Floats | None = None, *, over_runs: bool = True
) -> Band:
    """Average the returns of several runs, as far as the shortest run goes.

    Args:
        name: of the method, for the error.
        runs: the runs of the method.
        task: the task whose episodes count, ``(task_dim,)``; None takes all.
        over_runs: whether the range is that of the runs' means; if not, it is that of all episodes.

    Raises:
        ValueError: if the runs of the method called ``name`` were evaluated at different steps.
    """
    n = min(len(run.timesteps) for run in runs)
    timesteps = runs[0].timesteps[:n]
    if not all(np.array_equal(run.timesteps[:n], timesteps) for run in runs):
        raise ValueError(f"the runs of {name!r} were evaluated at different steps: give runs of one eval_freq.")
    returns = [_returns_of_task(run, task)[:n].T for run in runs]  # (n_episodes, n) each
    means = np.stack([mean_of_known(episodes) for episodes in returns])  # (n_runs, n)
    return Band.of(timesteps, means, None if over_runs else np.concatenate(returns))


def _returns_of_task(run: LearningCurve, task: Floats | None) -> Floats:
    """Select the returns on one task: ``(n_evals, n_episodes)``, with NaN for the episodes of other tasks."""
    return run.returns if task is None else np.where((run.tasks == task).all(axis=-1), run.returns, np.nan)


def _oracle_return(oracle: float | Mapping[str, float], task: Floats | None) -> float:
    """Return the oracle's return on ``task``, or its mean over all tasks if ``task`` is None."""
    if not isinstance(oracle, Mapping):
        return oracle
    if task is None:
        return float(np.mean(list(oracle.values())))
    if task_label(task) not in oracle:
        raise ValueError(f"oracle has {sorted(oracle)} and lacks task {task_label(task)!r}: add its return.")
    return oracle[task_label(task)]
