"""Refuses to run what somebody else may have written, unless the user trusts it: pickles, and settings that name code.

A run in a folder called ``logs`` or ``agents``, or in one within, is trusted: there, trainings and ``sb3-bruno pull``
write.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from sb3_bruno.zoo.saved_run import SavedRun

TRUSTED = {"logs", "agents"}
OURS = "sb3_bruno_envs"


def is_trusted(path: Path) -> bool:
    """Tell whether a file or a folder is in a folder that is trusted, whatever links lead there."""
    return bool(TRUSTED & set(path.resolve().parts))


def check_pickle(path: Path, *, trust: bool) -> None:
    """Refuse to load a pickle from a folder that is not trusted.

    Args:
        path: the pickle.
        trust: whether the user trusts it all the same.

    Raises:
        ValueError: naming the file and the flag.
    """
    if not trust and not is_trusted(path):
        raise ValueError(
            f"{path} would be loaded as a pickle, which may run any code of whoever made it, and is in no folder "
            "called logs or agents: give --trust if you know where it is from"
        )


def check_settings(saved: SavedRun, params: Path, packages: Iterable[str] = ()) -> None:
    """Refuse settings of a run that have code imported or evaluated, other than that of our environments.

    Args:
        saved: the settings.
        params: the folder that they are in, for the error.
        packages: those that the user has named.

    Raises:
        ValueError: naming what they ask for, and the flags.
    """
    named = [f"the package {package}" for package in saved.gym_packages if package not in {OURS, *packages}]
    for key in ("env_wrapper", "vec_env_wrapper"):
        wrappers = _names(saved.hyperparams.get(key))
        named += [f"the wrapper {name!r:.60}" for name in wrappers if not _is_ours(name)]
    if isinstance(saved.hyperparams["normalize"], str):
        named.append(f"the expression {saved.hyperparams['normalize']!r:.60}")
    if named:
        raise ValueError(
            f"{params} asks for {named[0]}, which is not ours: give --gym-packages with the package, or --trust for all"
        )


def _names(wrappers: Any) -> Iterator[Any]:
    """Yield the names of wrappers, as rl_zoo3 reads them: one or a list, each alone or with its arguments."""
    for wrapper in wrappers if isinstance(wrappers, list) else [] if wrappers is None else [wrappers]:
        yield from wrapper if isinstance(wrapper, dict) else [wrapper]


def _is_ours(name: Any) -> bool:
    return isinstance(name, str) and name.startswith(f"{OURS}.") and name.count(".") == 1
