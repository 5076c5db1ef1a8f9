"""Where a study is kept: a journal file on one machine, PostgreSQL beyond it."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import optuna
from optuna.exceptions import DuplicatedStudyError, ExperimentalWarning
from optuna.storages import JournalStorage, RDBStorage, RetryHeartbeatStaleTrialCallback
from optuna.storages.journal import JournalFileBackend
from sqlalchemy.exc import SQLAlchemyError

from sb3_bruno.zoo.one_line import in_one_line

SETTINGS = "settings"  # user attribute of a study: its SweepSettings
RETRIES = 3  # how often a trial that lost its worker is queued again


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


def open_storage(storage: str, heartbeat: int = 60) -> JournalStorage | RDBStorage:
    """Open a journal file (``.log``) or a database.

    Args:
        storage: the file, or the address of a PostgreSQL database. SQLite is refused: two workers break it.
        heartbeat: seconds between the heartbeats of a database's workers. After twice as many without one, a trial is
            failed and queued again.

    Raises:
        ValueError: if it is neither, or cannot be opened.
    """
    try:
        if storage.endswith(".log"):
            Path(storage).parent.mkdir(parents=True, exist_ok=True)
            return JournalStorage(JournalFileBackend(storage))
        if storage.startswith("postgresql"):
            return _open_database(storage, heartbeat)
    except (OSError, ImportError, ValueError, SQLAlchemyError) as error:
        raise ValueError(f"--storage {storage} cannot be opened: {in_one_line(error)}") from error
    raise ValueError(f"--storage {storage}: give a journal file (sweep.log) or a database (postgresql://...)")


def _open_database(url: str, heartbeat: int) -> RDBStorage:
    with warnings.catch_warnings(category=ExperimentalWarning, action="ignore"):
        return RDBStorage(
            url,
            heartbeat_interval=heartbeat,
            grace_period=2 * heartbeat,
            heartbeat_stale_trial_callback=RetryHeartbeatStaleTrialCallback(max_retry=RETRIES),
        )


def create_study(storage: str, name: str, settings: SweepSettings) -> optuna.Study:
    """Create a study, once, before its workers start.

    Args:
        storage: as ``open_storage`` takes it.
        name: the study's name in the storage.
        settings: what every trial is made of.

    Raises:
        ValueError: if JSON cannot hold the config, the storage cannot be opened, or has a study of that name.
    """
    check_config(settings["config"])
    try:
        study = optuna.create_study(study_name=name, storage=open_storage(storage), direction="maximize")
    except DuplicatedStudyError as error:
        raise ValueError(f"{storage} has a study {name}: choose another --study-name") from error
    study.set_user_attr(SETTINGS, settings)
    return study


def check_config(config: Mapping[str, Any]) -> None:
    """Check that a study can keep the hyperparameters, as JSON.

    Raises:
        ValueError: if one of them is no plain value, but a class, say.
    """
    for name, value in config.items():
        try:
            json.dumps(value)
        except (TypeError, ValueError) as error:
            problem = f"cannot be stored as JSON: {error}"
            raise ValueError(f"{name}={value} {problem}: give it as text in quotes, as a config file has it") from error


def load_study(storage: str, name: str) -> optuna.Study:
    """Load a study that ``create_study`` made.

    Raises:
        ValueError: if there is none; or if another program made it, such as ``train -optimize``; or if its making was
            interrupted.
    """
    try:
        study = optuna.load_study(study_name=name, storage=open_storage(storage))
    except KeyError as error:
        raise ValueError(f"no study {name} in {storage}: make it with sb3-bruno sweep init") from error
    settings = study.user_attrs.get(SETTINGS)
    if settings is None:
        problem = "was not made by sb3-bruno sweep init, or not to the end: make another --study-name with it"
        raise ValueError(f"study {name} in {storage} {problem}")
    study.sampler = optuna.samplers.TPESampler(n_startup_trials=settings["n_startup_trials"])
    first_third = settings["n_evaluations"] // 3  # little is learned in it yet, so nothing is pruned
    study.pruner = optuna.pruners.MedianPruner(settings["n_startup_trials"], n_warmup_steps=first_third + 1)
    return study
