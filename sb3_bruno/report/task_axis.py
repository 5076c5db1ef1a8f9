"""Sets results against the task's value, where a task is one number."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import pandas as pd

from sb3_bruno.evaluation.band import Band
from sb3_bruno.report.methods import Methods, config_of, every_run
from sb3_bruno.task_names import FEW_TASKS

_VALUE = re.compile(r"(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)(?: (\D.{0,20}))?")


class TaskAxis(NamedTuple):
    """The axes of a figure over tasks.

    Attributes:
        x: what a task's value is.
        y: what is drawn of each task.
        is_miss: whether that is minus the return per step, in the task's own units.
    """

    x: str
    y: str
    is_miss: bool = False


READS_AS_MISS = {
    # -|velocity - target| - 0.05 |action|^2 at each step, m/s
    "CheetahVel-v0": TaskAxis(
        "target speed, m/s", "mean miss of the speed, m/s\n(with the cost of control)", is_miss=True
    )
}
"""Environments whose reward is minus a miss, in the unit of the task."""


def task_axis(methods: Methods) -> TaskAxis | None:
    """Tell what to draw over the tasks of a page; None where tasks are few, or no single numbers in one unit."""
    runs = every_run(methods)
    labels = {str(task) for run in runs for task in run.episodes["task"].unique()}
    found = [_VALUE.fullmatch(label) for label in labels]
    units = {match[2] or "" for match in found if match}
    envs = {config_of(run)["env"] for run in runs}
    if len(labels) <= FEW_TASKS or None in found or len(units) != 1 or len(envs) != 1:
        return None
    unit = units.pop()
    return READS_AS_MISS.get(envs.pop()) or TaskAxis(f"task, {unit}" if unit else "task", "test return")


def task_bands(methods: Methods, measure: str, axis: TaskAxis) -> dict[str, Band]:
    """Compute what a page draws over its tasks, by method: the mean over the seeds, and their middle half."""
    bands = {}
    for name, runs in methods.items():
        scores = pd.concat([run.scores(measure) for run in runs], axis=1)  # a row per task, a column per seed
        values = np.array([float(_VALUE.fullmatch(str(label))[1]) for label in scores.index])  # type: ignore[index]
        drawn = scores.to_numpy()[np.argsort(values)].T
        if axis.is_miss:
            drawn = -drawn / int(measure.rpartition("_")[2])
        bands[name] = Band.of(np.sort(values), drawn)
    return bands
