"""What one worker does: trial after trial of a study, until there are enough."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import optuna
from optuna.trial import FrozenTrial, TrialState

from sb3_bruno.zoo.workers import COUNTED, GIVEN_BACK, give_back_surplus, queue_again, requeue_lost_trials

PATIENCE = 5  # trials that may fail one after another before a worker gives up
Objective = Callable[[optuna.Trial], float]


class GaveUp(Exception):
    """``PATIENCE`` trials of a worker failed one after another."""


def work(
    study: optuna.Study,
    objective: Objective,
    *,
    n_trials: int | None = None,
    max_total: int | None = None,
    after_trial: Callable[[], None] = lambda: None,
) -> None:
    """Run trials until the study has ``max_total``, or ``n_trials`` of this worker; without both, without end.

    Args:
        study: the study.
        objective: trains the agent of a trial, and returns its score. An error fails the trial.
        n_trials: how many trials this worker begins.
        max_total: how many trials count in the end, of all workers together.
        after_trial: called after each trial of this worker.

    Raises:
        GaveUp: if ``PATIENCE`` trials failed one after another.
    """

    def objective_of_those_asked_for(trial: optuna.Trial) -> float:
        if max_total is not None:
            give_back_surplus(trial, max_total)
        return objective(trial)

    n_failed = 0  # in a row
    for _ in itertools.count() if n_trials is None else range(n_trials):
        tell_of_lost_trials(study)
        if max_total is not None and len(study.get_trials(deepcopy=False, states=COUNTED)) >= max_total:
            return
        trial = run_trial(study, objective_of_those_asked_for)
        failed = trial is not None and trial.state == TrialState.FAIL and GIVEN_BACK not in trial.user_attrs
        n_failed = n_failed + 1 if failed else 0
        after_trial()
        if n_failed == PATIENCE:
            raise GaveUp(f"{PATIENCE} trials failed one after another, for the reason above: correct it, start again")


def run_trial(study: optuna.Study, objective: Objective) -> FrozenTrial | None:
    """Run one trial. An error fails it and is shown with its traceback; an interrupt queues it again.

    Returns:
        The trial; None if another worker took this one for dead, and finished its trial meanwhile.
    """
    asked: list[optuna.Trial] = []

    def noted(trial: optuna.Trial) -> float:
        asked.append(trial)
        return objective(trial)

    def as_kept() -> FrozenTrial:
        return study._storage.get_trial(asked[-1]._trial_id)

    try:
        study.optimize(noted, n_trials=1, catch=(Exception,), gc_after_trial=True)
    except KeyboardInterrupt:
        if asked and as_kept().state == TrialState.FAIL:
            queue_again(study, as_kept())
        raise
    except Exception as error:  # Optuna's, when it told the storage how the trial ended
        if asked and as_kept().state.is_finished():
            print(f"Trial {asked[-1].number} was taken from this worker, whose heartbeat was late: it takes another")
            return None
        if isinstance(error, AssertionError) and error.__context__ is not None:
            raise error.__context__ from None  # what the storage raised, after which Optuna fails an assertion
        raise
    return as_kept()


def tell_of_lost_trials(study: optuna.Study) -> None:
    """Queue the trials of workers that are gone again, and say so."""
    for number in requeue_lost_trials(study):
        print(f"Trial {number} lost its worker: queued again")
