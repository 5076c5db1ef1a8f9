"""The recorded runs of a page by method, and what the methods are called on it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from sb3_bruno.plotting.names import choices, method_name
from sb3_bruno.runs.record import RunRecord
from sb3_bruno.task_names import ALL_TASKS, pooled_title, task_title

Methods = dict[str, list[RunRecord]]
"""The runs of each method, one per seed, by its name."""


def methods_of(records: Sequence[RunRecord]) -> Methods:
    """Group records by their methods, as ``RunRecord.method`` names them."""
    methods: Methods = {}
    for record in records:
        methods.setdefault(record.method, []).append(record)
    return methods


def called(methods: Methods) -> tuple[Methods, list[str]]:
    """Call methods as people do, and leave out what all of several methods have in common.

    Returns:
        The methods by their new names, and what was left out. A name that two methods would share stays as it was.
    """
    configs = {method: config_of(runs[0]) for method, runs in methods.items()}
    shared = set.intersection(*(set(choices(config)) for config in configs.values())) if len(configs) > 1 else set()
    names = {method: method_name(config, shared) for method, config in configs.items()}
    count = Counter(names.values())
    unique = {method: name if count[name] == 1 else method for method, name in names.items()}
    first = next(iter(configs.values()))
    return {unique[method]: runs for method, runs in methods.items()}, [x for x in choices(first) if x in shared]


def config_of(run: RunRecord) -> Mapping[str, Any]:
    """Return the settings that a record keeps."""
    config: Mapping[str, Any] = run.about["config"]
    return config


def every_run(methods: Methods) -> list[RunRecord]:
    """Return the runs of all methods."""
    return [run for runs in methods.values() for run in runs]


def shared_measures(methods: Methods) -> list[str]:
    """Return the measures that all runs have, the longest horizon last.

    Raises:
        ValueError: if there is none.
    """
    first, *others = every_run(methods)
    measures = [measure for measure in first.measures if all(measure in other.measures for other in others)]
    if not measures:
        raise ValueError("the runs were tested over different numbers of steps: evaluate all with the same --steps")
    return measures


def measure_title(measure: str) -> str:
    """Return the head of a measure's column: "1,000 steps" for return_1000, "episode 2" for episode_2."""
    if measure == "success_percent":
        return "success, %"
    kind, number = measure.split("_")
    return f"{int(number):,} steps" if kind == "return" else f"episode {number}"


def few_tasks(methods: Methods) -> list[str]:
    """Return the tasks of all runs together; none if some run has so many that its record pools them."""
    tasks = dict.fromkeys(task for run in every_run(methods) for task in run.rewards["task"].unique())
    return [] if ALL_TASKS in tasks else list(tasks)


def panel_title(task: str, methods: Methods) -> str:
    """Return the title of a task's panel, or of the panel for all tasks if ``task`` is empty."""
    return task_title(task) if task else pooled_title(max(run.episodes["task"].nunique() for run in every_run(methods)))
