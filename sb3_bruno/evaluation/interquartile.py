"""The interquartile mean with its confidence interval, by rliable; needs the ``plots`` extra."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Interval(NamedTuple):
    """A point estimate and its confidence interval, in the unit of the estimate."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: NDArray[np.floating[Any]], *, n_resamples: int = 2_000, seed: int = 0) -> Interval:
    """The mean of the middle half of all scores, with the 95 % interval of the percentile bootstrap.

    Agarwal et al. (2021, arXiv:2108.13264). The runs are resampled within each task.

    Args:
        scores: ``(n_runs, n_tasks)``.
        n_resamples: of the bootstrap.
        seed: of the bootstrap.
    """
    from rliable import library, metrics

    state = np.random.get_state()  # noqa: NPY002  # rliable draws from it whatever it is passed
    np.random.seed(seed)  # noqa: NPY002
    try:
        values, intervals = library.get_interval_estimates(
            {"": scores}, lambda drawn: np.array([metrics.aggregate_iqm(drawn)]), reps=n_resamples
        )
    finally:
        np.random.set_state(state)  # noqa: NPY002
    return Interval(float(values[""][0]), *map(float, intervals[""][:, 0]))
