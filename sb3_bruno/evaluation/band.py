"""A line and the range around it: the mean, the lowest and the highest of some samples at each step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.evaluation.floats import Floats, mean_of_known


class Band(NamedTuple):
    """A line and the range around it.

    Attributes:
        x: positions on the horizontal axis, ``(n,)``.
        mean: the line, ``(n,)``.
        low: the lowest values, ``(n,)``.
        high: the highest values, ``(n,)``.
    """

    x: NDArray[np.int64] | Floats
    mean: Floats
    low: Floats
    high: Floats

    @classmethod
    def of(cls, x: NDArray[np.int64] | Floats, samples: Floats, spread: Floats | None = None) -> Band:
        """Take mean and range over the first axis. NaN is no sample; where there is none, the band is NaN.

        Args:
            x: positions on the horizontal axis, ``(n,)``.
            samples: what the mean is taken of, ``(n_samples, n)``.
            spread: what the range is taken of, ``(n_others, n)``; None takes ``samples``.
        """
        spread = samples if spread is None else spread
        return cls(x, mean_of_known(samples), np.fmin.reduce(spread, axis=0), np.fmax.reduce(spread, axis=0))
