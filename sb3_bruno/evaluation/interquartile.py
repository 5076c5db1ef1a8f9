"""The interquartile mean with its confidence interval, by rliable; needs the ``plots`` extra."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sb3_bruno.evaluation.floats import Floats


class Interval(NamedTuple):
    """A point estimate and its confidence interval, in the unit of the estimate."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: Floats, *, n_resamples: int = 2_000, seed: int = 0) -> Interval:
    """Compute the mean of the middle half of all scores, with the 95 % interval of the percentile bootstrap.

    The bootstrap resamples the runs within each task. Three scores or fewer have no quarter to cut off, so the mean is
    the plain one. Leaves NumPy's global random state as it was.

    Reference: Agarwal et al. (2021, arXiv:2108.13264).

    Args:
        scores: ``(n_runs, n_tasks)``.
        n_resamples: number of the bootstrap's resamples.
        seed: of the bootstrap.
    """
    from rliable import library, metrics

    state = np.random.get_state()  # noqa: NPY002  # rliable draws from the global state, whatever it is given
    np.random.seed(seed)  # noqa: NPY002
    try:
        values, intervals = library.get_interval_estimates(
            {"": scores}, lambda drawn: np.array([metrics.aggregate_iqm(drawn)]), reps=n_resamples
        )
    finally:
        np.random.set_state(state)  # noqa: NPY002
    return Interval(float(values[""][0]), *map(float, intervals[""][:, 0]))
