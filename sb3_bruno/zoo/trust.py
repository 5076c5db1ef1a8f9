"""Refuses to run what somebody else may have written, unless the user trusts it: pickles, and settings that name code.

A run in a folder called ``logs`` or ``agents``, or in one within, is trusted: there, trainings and ``sb3-bruno pull``
write.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

from sb3_bruno.files.shown import shown
from sb3_bruno.zoo.plain_text import CALLED, names_a
from sb3_bruno.zoo.saved_run import SavedRun

TRUSTED = {"logs", "agents"}
OURS = "sb3_bruno_envs"
WRAPPERS = ("env_wrapper", "vec_env_wrapper")
LARGEST = 100_000
"""Up to which numbers an environment is made with: steps of an episode, episodes of a trial."""


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


def check_settings(
    saved: SavedRun, params: Path, packages: Collection[str] = (), *, remedy: str = "give --trust if you know its maker"
) -> None:
    """Refuse settings of a run that have code run, other than that of our environments, or have it run for long.

    Args:
        saved: the settings.
        params: the folder that they are in, for the error.
        packages: those that the user has named, whose wrappers are welcome too.
        remedy: what else the user can do, for the errors.

    Raises:
        ValueError: naming what they ask for, and the flags.
    """
    named = [f"the package {shown(package)}" for package in saved.gym_packages if package not in {OURS, *packages}]
    for key in WRAPPERS:
        wrappers = _names(saved.hyperparams.get(key))
        named += [f"the wrapper {shown(name)}" for name in wrappers if not _is_welcome(name, CALLED[key], packages)]
    if named:
        raise ValueError(
            f"{params} asks for {named[0]}, which is not ours: give --gym-packages its package, or {remedy}"
        )
    if isinstance(saved.hyperparams["normalize"], str):
        raise ValueError(f"{params} asks for the expression {shown(saved.hyperparams['normalize'])}: {remedy}")
    given = [saved.env_kwargs, *(saved.hyperparams.get(key) for key in WRAPPERS)]
    for name, number in (entry for settings in given for entry in _numbers(settings)):
        if not abs(number) <= LARGEST:  # nor is NaN
            raise ValueError(
                f"{params} asks for {name}={shown(number)}, and others may ask for {LARGEST:,} at most: {remedy}"
            )


def _numbers(nested: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield the numbers in settings, each with the name that is nearest."""
    if isinstance(nested, dict):
        for key, value in nested.items():
            yield from _numbers(value, shown(key))
    elif isinstance(nested, list | tuple):
        for value in nested:
            yield from _numbers(value, name)
    elif isinstance(nested, int | float):
        yield name, nested


def _names(wrappers: Any) -> Iterator[str]:
    """Yield the names of wrappers, as rl_zoo3 reads them: one or a list, each alone or with its arguments."""
    for wrapper in wrappers if isinstance(wrappers, list) else [] if wrappers is None else [wrappers]:
        yield from wrapper if isinstance(wrapper, dict) else [wrapper]


def _is_welcome(name: str, kind: type, packages: Iterable[str]) -> bool:
    """Tell whether "sb3_bruno_envs.Name" is a wrapper of ours, or "package.module.Name" one of a package named."""
    is_ours = name.startswith(f"{OURS}.") and name.count(".") == 1
    return (is_ours or any(name.startswith(f"{package}.") for package in packages)) and names_a(kind, name)
