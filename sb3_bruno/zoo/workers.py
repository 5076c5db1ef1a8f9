"""Workers share a study: none makes a trial too many, and a trial whose worker is gone is queued again."""

from __future__ import annotations

import os
import platform
import warnings
from datetime import datetime
from typing import Any

import optuna
import psutil
from optuna.exceptions import ExperimentalWarning
from optuna.storages import JournalStorage, RetryHeartbeatStaleTrialCallback
from optuna.trial import TrialState

from sb3_bruno.zoo.study import RETRIES

OWNER = "worker"  # user attribute of a trial: {"host": ..., "pid": ..., "started": seconds since the epoch}
GIVEN_BACK = "given_back"  # user attribute of a trial that was one too many
COUNTED = (TrialState.COMPLETE, TrialState.PRUNED, TrialState.RUNNING)


class SurplusTrial(Exception):
    """A trial beyond the number asked for: another worker began one after this worker had counted them."""


def give_back_surplus(trial: optuna.Trial, max_total: int) -> None:
    """Refuse a trial if ``max_total`` others have smaller numbers, so that racing workers never make too many.

    A storage numbers trials one by one, so a worker that has its number sees every smaller one. Waiting trials count
    too, because they will run: whichever worker takes one has the smaller number.

    Example: of 3 trials, 0 and 2 run, and 1 was lost and waits as 3. Two workers come. The first takes 3: two trials
    have smaller numbers, so it goes ahead. The second makes 4: three have smaller numbers, so it gives 4 back.

    Raises:
        SurplusTrial: which fails the trial, so that it no longer counts.
    """
    alive = trial.study.get_trials(deepcopy=False, states=(*COUNTED, TrialState.WAITING))
    if sum(other.number < trial.number for other in alive) >= max_total:
        trial.set_user_attr(GIVEN_BACK, True)
        raise SurplusTrial(f"trial {trial.number} is one more than {max_total}, so it is given back")


def this_process() -> dict[str, Any]:
    """Identify this process among all others, later ones with the same number included."""
    return {"host": platform.node(), "pid": os.getpid(), "started": psutil.Process().create_time()}


def is_gone(owner: dict[str, Any]) -> bool:
    """Tell whether a worker on this machine has ended. Workers on other machines count as alive."""
    if owner["host"] != platform.node():
        return False
    try:
        return bool(abs(psutil.Process(owner["pid"]).create_time() - owner["started"]) > 1)
    except psutil.NoSuchProcess:
        return True


def has_not_begun(trial: optuna.trial.FrozenTrial, patience: float = 60.0) -> bool:
    """Tell whether a trial's worker died before it signed the trial, which takes milliseconds.

    Args:
        trial: a running trial without an owner.
        patience: seconds to wait for a signature.
    """
    assert trial.datetime_start is not None  # it runs
    return (datetime.now() - trial.datetime_start).total_seconds() > patience


def requeue_lost_trials(study: optuna.Study) -> list[int]:
    """Fail the trials whose worker is gone, and queue them again. A database finds them by their heartbeat.

    Returns:
        The numbers of the trials that this call failed; none for a database, which does not say.
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
