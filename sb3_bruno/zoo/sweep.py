"""Hyperparameter sweeps by any number of workers, any of which may be killed at any moment.

A study lives in a journal file on one machine, or in PostgreSQL beyond it. Each trial is an ordinary training run; its
value is the return on training tasks that it was not trained on. Test tasks are never looked at.
"""

from __future__ import annotations

import argparse
import copy
import os
import platform
import warnings
from datetime import datetime
from pathlib import Path
from typing import Any

import optuna
import psutil
import rl_zoo3
from optuna.exceptions import ExperimentalWarning
from optuna.storages import JournalStorage, RDBStorage, RetryHeartbeatStaleTrialCallback
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState
from rl_zoo3.callbacks import TrialEvalCallback
from rl_zoo3.hyperparams_opt import HYPERPARAMS_SAMPLER
from sqlalchemy.exc import SQLAlchemyError
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.zoo.configs import merged
from sb3_bruno.zoo.experiment import TaskExperiment
from sb3_bruno.zoo.one_line import in_one_line

OWNER = "worker"  # user attribute of a trial: {"host": ..., "pid": ..., "started": seconds since the epoch}
SETTINGS = "settings"  # user attribute of a study: what every trial is made of
GIVEN_BACK = "given_back"  # user attribute of a trial that was one too many
COUNTED = (TrialState.COMPLETE, TrialState.PRUNED, TrialState.RUNNING)
RETRIES = 3


def open_storage(storage: str, heartbeat: int = 60) -> JournalStorage | RDBStorage:
    """A journal file (``.log``) or a database.

    :param heartbeat: seconds between the heartbeats of a database's workers; after twice as many without one a trial is
        failed and queued again
    :raises ValueError: if it is neither, or SQLite, which two workers break, or cannot be reached
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


def create_study(storage: str, name: str, settings: dict[str, Any]) -> optuna.Study:
    """Create a study for any number of workers.

    Args:
        storage: a journal file (``.log``) or the address of a PostgreSQL database.
        name: the study's name in the storage.
        settings: what every trial is made of.

    Raises:
        ValueError: if the storage has a study of that name, or cannot be opened.
    """
    try:
        study = optuna.create_study(study_name=name, storage=open_storage(storage), direction="maximize")
    except optuna.exceptions.DuplicatedStudyError as error:
        raise ValueError(f"{storage} has a study {name}: choose another --study-name") from error
    study.set_user_attr(SETTINGS, settings)
    return study


def load_study(storage: str, name: str) -> optuna.Study:
    """The study that ``sweep init`` made.

    :raises ValueError: if there is none, or another made it, such as ``train -optimize``, or ``init`` did not end
    """
    try:
        study = optuna.load_study(study_name=name, storage=open_storage(storage))
    except KeyError as error:
        raise ValueError(f"no study {name} in {storage}: make it with sb3-bruno sweep init") from error
    settings = study.user_attrs.get(SETTINGS)
    if settings is None:
        made = "was not made by sb3-bruno sweep init, or not to the end: make another --study-name with it"
        raise ValueError(f"study {name} in {storage} {made}")
    study.sampler = optuna.samplers.TPESampler(n_startup_trials=settings["n_startup_trials"])
    first_third = settings["n_evaluations"] // 3  # of a trial, in which little is learned yet: none is pruned there
    study.pruner = optuna.pruners.MedianPruner(settings["n_startup_trials"], n_warmup_steps=first_third + 1)
    return study


class SurplusTrial(Exception):
    """A trial beyond the number asked for: its worker had counted before another one's trial began."""


def give_back_surplus(trial: optuna.Trial, max_total: int) -> None:
    """Refuse a trial that ``max_total`` others come before, by number: so workers that race never make too many.

    A storage numbers trials one by one, so a worker that has its number sees every smaller one. Waiting trials count
    too, for they will run: whichever worker takes one has the smaller number.

    Example: of 3, trials 0 and 2 run and 1 was lost and waits as 3. Of two workers that come now one takes 3, which
    two come before, and one makes 4, which three come before, and gives it back.

    :raises SurplusTrial: which fails the trial, so that it counts no more
    """
    alive = trial.study.get_trials(deepcopy=False, states=(*COUNTED, TrialState.WAITING))
    if sum(one.number < trial.number for one in alive) >= max_total:
        trial.set_user_attr(GIVEN_BACK, True)
        raise SurplusTrial(f"trial {trial.number} is one more than {max_total}, so it is given back")


class SweepExperiment(TaskExperiment):
    """The training run of each trial.

    :param settings: the study's, as ``sweep init`` stored them
    """

    def __init__(self, settings: dict[str, Any]) -> None:
        self._config = settings["config"]
        super().__init__(
            argparse.Namespace(),
            settings["algo"],
            settings["env"],
            "logs",
            n_timesteps=settings["n_timesteps"],
            optimize_hyperparameters=True,
            n_eval_episodes=10,
            n_evaluations=settings["n_evaluations"],
            seed=settings["seed"],
            verbose=0,
            device="cpu",
        )
        self.setup_experiment()

    def read_hyperparameters(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Those that the study keeps: a worker on another machine has other files."""
        return copy.deepcopy(self._config), self._config

    def create_log_folder(self) -> None:
        """A trial leaves no folder."""

    def create_envs(self, n_envs: int, eval_env: bool = False, no_log: bool = False) -> VecEnv:
        """Without monitor files."""
        return super().create_envs(n_envs, eval_env, no_log=True)

    def check(self) -> None:
        """Make a model once, so that a mistake shows before any worker starts."""
        if not isinstance(self.n_envs, int) or self.n_envs < 1:
            raise ValueError(f"n_envs={self.n_envs!r} is not a positive integer: give at least 1")
        env = self.create_envs(1)
        try:
            rl_zoo3.ALGOS[self.algo](env=env, device="cpu", **self._hyperparams)
        finally:
            env.close()

    def objective(self, trial: optuna.Trial) -> float:
        """Train with drawn hyperparameters; the mean return of the last evaluation.

        What a trial raises is the trial's error: it fails, and is not pruned.
        """
        trial.set_user_attr(OWNER, this_process())
        drawn = HYPERPARAMS_SAMPLER[self.algo](trial, self.n_actions, self.n_envs, self._additional_args())
        env, eval_env = self.create_envs(self.n_envs), self.create_envs(1, eval_env=True)
        try:
            hyperparams = merged(self._hyperparams, drawn)
            model = rl_zoo3.ALGOS[self.algo](env=env, seed=self.seed + trial.number, device="cpu", **hyperparams)
            evaluate = TrialEvalCallback(
                eval_env,
                trial,
                n_eval_episodes=self.n_eval_episodes,
                eval_freq=max(self.n_timesteps // self.n_evaluations // self.n_envs, 1),
            )
            model.learn(self.n_timesteps, evaluate)
        finally:
            env.close()
            eval_env.close()
        if evaluate.is_pruned:
            raise optuna.TrialPruned
        return float(evaluate.last_mean_reward)

    def _additional_args(self) -> dict[str, Any]:
        """What rl_zoo3's search spaces ask for besides."""
        return {
            "using_her_replay_buffer": self._hyperparams.get("replay_buffer_class") is HerReplayBuffer,
            "her_kwargs": self._hyperparams.get("replay_buffer_kwargs", {}),
        }


def this_process() -> dict[str, Any]:
    """What tells this process from every other, also from a later one with its number."""
    return {"host": platform.node(), "pid": os.getpid(), "started": psutil.Process().create_time()}


def is_gone(owner: dict[str, Any]) -> bool:
    """Whether a worker of this machine has ended; of another machine nothing is known."""
    if owner["host"] != platform.node():
        return False
    try:
        return bool(abs(psutil.Process(owner["pid"]).create_time() - owner["started"]) > 1)
    except psutil.NoSuchProcess:
        return True


def has_not_begun(trial: optuna.trial.FrozenTrial, patience: float = 60.0) -> bool:
    """Whether a trial's worker died before it put its name to it: that takes milliseconds."""
    assert trial.datetime_start is not None  # it runs
    return (datetime.now() - trial.datetime_start).total_seconds() > patience


def requeue_lost_trials(study: optuna.Study) -> list[int]:
    """Fail the trials whose worker is gone, and queue them again: those of a database by their heartbeat.

    :return: the numbers of the trials of a journal that this call failed; a database does not tell
    """
    if not isinstance(study._storage, JournalStorage):
        with warnings.catch_warnings(category=ExperimentalWarning, action="ignore"):
            optuna.storages.fail_stale_trials(study)
        return []
    lost = []
    for trial in study.get_trials(states=[TrialState.RUNNING]):
        owner = trial.user_attrs.pop(OWNER, None)
        if not (has_not_begun(trial) if owner is None else is_gone(owner)):
            continue
        try:
            study.tell(trial.number, state=TrialState.FAIL)
        except (optuna.exceptions.UpdateFinishedTrialError, ValueError):  # another worker was faster
            continue
        with warnings.catch_warnings(category=ExperimentalWarning, action="ignore"):
            RetryHeartbeatStaleTrialCallback(max_retry=RETRIES)(study, trial)
        lost.append(trial.number)
    return lost
