"""Finds the test of a run, and refuses tests and records that were damaged or that another program wrote."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from sb3_bruno.evaluation.adaptation_result import AdaptationResult


def find_test(run: Path) -> tuple[Path, AdaptationResult]:
    """Return the folder of a run and its test.

    Args:
        run: the file of the test; or the folder. Of its tests on the agent as it was trained last, those on the test
            tasks of its own training come first; of these the longest counts, and of equally long ones that with the
            shortest name: ``adaptation.json`` before ``adaptation_stochastic.json``.

    Raises:
        ValueError: if there is no test, or one is damaged.
    """
    if run.is_file():
        return run.parent, AdaptationResult.load(run)
    tests = {path: AdaptationResult.load(path) for path in sorted(run.glob("adaptation*.json"))}
    if not tests:
        raise ValueError(f"no adaptation.json in {run}: test the run by `sb3-bruno evaluate` first")
    for path, test in tests.items():
        check_config(test.config, path, len(test.tasks))

    def rank(path: Path) -> tuple[int, bool, int, int]:
        config = tests[path].config
        is_own = config.get("split", "test") == "test" and config.get("tasks") is None
        return config["env_steps"], is_own, tests[path].horizon, -len(path.name)

    return run, tests[max(tests, key=rank)]


def check_config(config: Any, source: Path, n_tasks: int | None = None) -> None:
    """Refuse a test's settings that do not name its algorithm, environment and length of training, or that are damaged.

    Args:
        config: the settings.
        source: the file or folder that they are from.
        n_tasks: how many tasks were tested; None if that is not known.

    Raises:
        ValueError: naming what is wrong.
    """
    found = config if isinstance(config, dict) else {}
    wrong = [name for name, holds in NEEDED.items() if not holds(found.get(name))]
    wrong += [name for name, holds in OPTIONAL.items() if found.get(name) is not None and not holds(found[name])]
    inside = found.get("inside_train_box")
    if n_tasks is not None and isinstance(inside, list) and len(inside) != n_tasks:
        wrong.append("inside_train_box")
    if wrong:
        told = ", ".join(f"{name}={found.get(name)!r:.60}" for name in dict.fromkeys(wrong))
        raise ValueError(f"{source}: the test's config has {told}: test the run by `sb3-bruno evaluate`")


def check_record(about: Any, tables: Sequence[pd.DataFrame], folder: Path) -> None:
    """Refuse a record that lacks something, or holds another kind of it.

    Args:
        about: what ``run.json`` holds.
        tables: ``RunRecord.learning``, ``episodes`` and ``rewards``.
        folder: the record's.

    Raises:
        ValueError: naming the folder.
    """
    kinds = {"config": dict, "versions": dict, "steps_to_90": dict}
    is_whole = isinstance(about, dict) and all(isinstance(about.get(name), kind) for name, kind in kinds.items())
    if not is_whole or not _is_test(about) or not all(map(_holds, tables, COLUMNS)):
        raise ValueError(f"{folder} holds no record of a run: record it again, or delete it")
    check_config(about["config"], folder)


def _is_test(about: Mapping[str, Any]) -> bool:
    """Tell whether the versions are text, and the steps to 90 % are numbers."""
    texts, steps = about["versions"].values(), about["steps_to_90"].values()
    return all(isinstance(text, str) for text in texts) and len(steps) > 0 and all(map(_is_number, steps))


def _holds(table: pd.DataFrame, columns: set[str]) -> bool:
    """Tell whether a table has these columns, and nothing but tasks and numbers."""
    names = {str(name) for name in table.columns}
    measured = columns != COLUMNS[1] or any(MEASURE.fullmatch(name) for name in names - columns)
    if not columns <= names or not measured or table.empty:
        return False
    return all(pd.api.types.is_numeric_dtype(table[name]) for name in names - {"task"})


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


NEEDED: dict[str, Callable[[Any], bool]] = {
    "algo": lambda value: isinstance(value, str),
    "env": lambda value: isinstance(value, str),
    "env_steps": _is_count,
}
OPTIONAL: dict[str, Callable[[Any], bool]] = {
    "conf": lambda value: isinstance(value, str),
    "deterministic": lambda value: isinstance(value, bool),
    "inside_train_box": lambda value: isinstance(value, list) and all(isinstance(is_in, bool) for is_in in value),
    "n_inner_episodes": lambda value: _is_count(value) and value > 0,
    "params": lambda value: isinstance(value, dict),
    "split": lambda value: isinstance(value, str),
    "trained_at": lambda value: isinstance(value, list) and all(isinstance(commit, str) for commit in value),
    "wall_seconds": _is_number,
}
"""What a test's settings hold, which a page reads. None says that nobody knows."""
COLUMNS = ({"timesteps", "task", "return"}, {"task", "episode"}, {"task", "step", "mean", "low", "high"})
"""Of the tables of a record; the episodes have measures besides."""
MEASURE = re.compile(r"(return|episode)_\d+|success_percent")
