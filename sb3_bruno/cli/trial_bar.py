"""A progress bar of a study's trials, on a terminal alone."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import optuna
from optuna.trial import TrialState
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

DONE = (TrialState.COMPLETE, TrialState.PRUNED)


@contextmanager
def trial_bar(study: optuna.Study, n_trials: int | None, max_total: int | None) -> Iterator[Callable[[], None]]:
    """Show how many trials are done, and the best so far. Optuna's messages appear above the bar.

    Args:
        study: the study.
        n_trials: how many trials this worker begins.
        max_total: how many trials count in the end; the bar then shows those of all workers.

    Yields:
        What to call after each trial.
    """
    with (
        tqdm(
            desc=study.study_name, total=max_total or n_trials, unit="trial", disable=None
        ) as bar,  # None: no terminal
        logging_redirect_tqdm([logging.getLogger("optuna")]),
    ):

        def advance() -> None:
            done = study.get_trials(deepcopy=False, states=DONE)
            bar.update(len(done) - bar.n if max_total is not None else 1)
            complete = [trial for trial in done if trial.state == TrialState.COMPLETE]
            if complete:
                bar.set_postfix_str(f"best {study.best_value:.2f} of trial {study.best_trial.number}")

        if max_total is not None:
            bar.update(len(study.get_trials(deepcopy=False, states=DONE)))
        yield advance
