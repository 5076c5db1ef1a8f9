"""Workers share a study: none makes a trial too many, and a trial whose worker is gone is queued again."""

from __future__ import annotations

import warnings
from datetime import datetime

import optuna
from optuna.exceptions import ExperimentalWarning
from optuna.storages import RetryHeartbeatStaleTrialCallback
from optuna.storages._cached_storage import _CachedStorage
from optuna.storages._rdb.models import TrialModel
from optuna.trial import FrozenTrial, TrialState

from sb3_bruno.zoo.database import RETRIES
from sb3_bruno.zoo.processes import is_gone

OWNER = "worker"  # user attribute of a trial: the process that works on it
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


def requeue_lost_trials(study: optuna.Study) -> list[int]:
    """Fail the trials whose worker is gone, and queue them again.

    Returns:
        The numbers of the trials that this call failed. Those that a database failed for want of heartbeats are not
        among them: it does not say which.
    """
    with warnings.catch_warnings(category=ExperimentalWarning, action="ignore"):
        optuna.storages.fail_stale_trials(study)  # a journal has no heartbeats, and fails none
    is_database = isinstance(study._storage, _CachedStorage)  # in which Optuna wraps one
    lost = _silent(study) if is_database else _left_behind(study)
    return [trial.number for trial in lost if _fail(study, trial)]


def queue_again(study: optuna.Study, trial: FrozenTrial) -> None:
    """Queue a trial that failed through no fault of its own, ``RETRIES`` times at most."""
    trial.user_attrs.pop(OWNER, None)
    with warnings.catch_warnings(category=ExperimentalWarning, action="ignore"):
        RetryHeartbeatStaleTrialCallback(max_retry=RETRIES)(study, trial)


def has_not_begun(trial: FrozenTrial, patience: float = 60.0) -> bool:
    """Tell whether a trial's worker died before it signed the trial, which takes milliseconds.

    Args:
        trial: a running trial without a signature: an owner in a journal, a heartbeat in a database.
        patience: seconds to wait for one, either way, because another machine's clock may be ahead.
    """
    assert trial.datetime_start is not None  # it runs
    return abs((datetime.now() - trial.datetime_start).total_seconds()) > patience


def _left_behind(study: optuna.Study) -> list[FrozenTrial]:
    """Find the trials of a journal whose worker on this machine has ended."""
    running = study.get_trials(states=[TrialState.RUNNING])
    owners = [trial.user_attrs.get(OWNER) for trial in running]
    return [
        trial
        for trial, owner in zip(running, owners, strict=True)
        if (has_not_begun(trial) if owner is None else is_gone(owner))
    ]


def _silent(study: optuna.Study) -> list[FrozenTrial]:
    """Find the trials of a database whose worker died before its first heartbeat. Optuna leaves those running."""
    storage = study._storage
    assert isinstance(storage, _CachedStorage) and storage._backend.grace_period is not None  # as open_storage made it
    patience = storage._backend.grace_period
    with storage._backend.scoped_session() as session:
        running = session.query(TrialModel).filter_by(study_id=study._study_id, state=TrialState.RUNNING)
        numbers = {trial.number for trial in running.filter(~TrialModel.heartbeats.any())}
    return [trial for trial in study.get_trials() if trial.number in numbers and has_not_begun(trial, patience)]


def _fail(study: optuna.Study, trial: FrozenTrial) -> bool:
    """Fail a lost trial and queue it again; return False if another worker was faster."""
    try:
        study.tell(trial.number, state=TrialState.FAIL)
    except (optuna.exceptions.UpdateFinishedTrialError, ValueError):
        return False
    queue_again(study, trial)
    return True
