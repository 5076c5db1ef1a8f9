"""A study: what its trials are made of, kept with them in a storage, and the code that it was begun with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, NotRequired, TypedDict

import optuna
from optuna.exceptions import DuplicatedStudyError
from optuna.storages import BaseStorage

import sb3_bruno
from sb3_bruno.evaluation.versions import library_versions
from sb3_bruno.zoo.storage import is_missing, open_storage, without_password

SETTINGS = "settings"  # user attribute of a study: its SweepSettings
CODE = "code"  # user attribute of a study: the package's version and commit when it was made
LONGEST_NAME = 512  # characters, in a database


class SweepSettings(TypedDict):
    """What every trial of a study is made of, in values that JSON can hold.

    Attributes:
        algo: rl_zoo3's name of the algorithm.
        env: id of the environment.
        gym_packages: packages to import, which register environments.
        config: the hyperparameters that are not drawn.
        n_timesteps: environment steps of a trial.
        n_evaluations: evaluations of a trial, after each of which it may be pruned.
        n_startup_trials: trials whose hyperparameters are drawn at random first.
        seed: of the first trial; each trial adds its number.
    """

    algo: str
    env: str
    gym_packages: NotRequired[list[str]]
    config: dict[str, Any]
    n_timesteps: int
    n_evaluations: int
    n_startup_trials: int
    seed: int


def create_study(storage: str, name: str, settings: SweepSettings) -> optuna.Study:
    """Create a study, once, before its workers start.

    Args:
        storage: as ``open_storage`` takes it.
        name: the study's name in the storage.
        settings: what every trial is made of.

    Raises:
        ValueError: if the name or the config cannot be kept, the storage cannot be opened, or has a study of that name.
    """
    check_config(settings["config"])
    if not 0 < len(name) <= LONGEST_NAME or not name.isprintable():
        raise ValueError(f"--study-name {name!r}: give 1 to {LONGEST_NAME} printable characters")
    try:
        study = optuna.create_study(study_name=name, storage=open_storage(storage), direction="maximize")
    except DuplicatedStudyError as error:
        raise ValueError(f"{without_password(storage)} has a study {name}: choose another --study-name") from error
    study.set_user_attr(CODE, this_code())
    study.set_user_attr(SETTINGS, settings)  # the last, because load_study refuses a study without
    return study


def check_config(config: Mapping[str, Any]) -> None:
    """Check that a study can keep the hyperparameters, as JSON.

    Raises:
        ValueError: if one of them is no plain value, but a class, say.
    """
    for name, value in config.items():
        try:
            kept = json.loads(json.dumps(value))
        except (TypeError, ValueError) as error:
            problem = f"cannot be stored as JSON: {error}"
            raise ValueError(f"{name}={value} {problem}: give it as text in quotes, as a config file has it") from error
        if kept != _with_lists(value):
            raise ValueError(f"{name}={value} cannot be stored as JSON, which would make it {kept}: give another value")


def _with_lists(value: Any) -> Any:
    """Return a value with its tuples as lists, which JSON makes of them and RL Zoo's configs have too."""
    if isinstance(value, dict):
        return {name: _with_lists(inner) for name, inner in value.items()}
    return [_with_lists(inner) for inner in value] if isinstance(value, list | tuple) else value


def load_study(storage: str, name: str) -> optuna.Study:
    """Load a study that ``create_study`` made. Nothing is made if there is none.

    Raises:
        ValueError: if there is none; or if another program made it, such as ``train -optimize``; or if its making was
            interrupted.
    """
    given = without_password(storage)
    if is_missing(storage):
        raise ValueError(f"no study {name} in {given}, which is no file: make it with sb3-bruno sweep init")
    opened = open_storage(storage)
    try:
        study = optuna.load_study(study_name=name, storage=opened)
    except KeyError as error:
        raise ValueError(f"no study {name} in {given}{_those_there(opened, name)}") from error
    settings = study.user_attrs.get(SETTINGS)
    if not isinstance(settings, dict):
        problem = "was not made by sb3-bruno sweep init, or not to the end: make another --study-name with it"
        raise ValueError(f"study {name} in {given} {problem}")
    study.sampler = optuna.samplers.TPESampler(n_startup_trials=settings["n_startup_trials"])
    first_third = settings["n_evaluations"] // 3  # little is learned in it yet, so nothing is pruned
    study.pruner = optuna.pruners.MedianPruner(settings["n_startup_trials"], n_warmup_steps=first_third + 1)
    return study


def _those_there(storage: BaseStorage, name: str) -> str:
    """List the studies of a storage, as the end of an error's message."""
    names = sorted(optuna.get_all_study_names(storage))
    if not names:
        return ": make it with sb3-bruno sweep init"
    nearest = get_close_matches(name, names, n=1)
    question = f", did you mean {nearest[0]}?" if nearest else "."
    return f"{question} It has {', '.join(names)}: give one of them, or make yours with sb3-bruno sweep init"


def this_code() -> dict[str, str]:
    """Return the package's version, and its commit if it runs from a clone."""
    commit = library_versions().get("commit")
    return {"version": sb3_bruno.__version__} | ({"commit": commit} if commit else {})


def other_code(study: optuna.Study) -> str | None:
    """Return a warning if a study was begun with other code than this, whose trials may not compare with its own."""
    begun, now = study.user_attrs.get(CODE), this_code()
    if begun == now:
        return None
    told = [" at commit ".join(map(str, code.values())) if isinstance(code, dict) else "?" for code in (begun, now)]
    return f"study {study.study_name} was begun with sb3_bruno {told[0]}, and this is {told[1]}: trials may not compare"
