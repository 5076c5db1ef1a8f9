"""A line and the range around it: the mean and the middle half of some samples at each step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.evaluation.floats import Floats, mean_of_known

MIDDLE_HALF = (0.25, 0.75)


class Band(NamedTuple):
    """A line and the range around it.

    Attributes:
        x: positions on the horizontal axis, ``(n,)``.
        mean: the line, ``(n,)``.
        low: the lower end of the range, ``(n,)``.
        high: its upper end, ``(n,)``.
    """

    x: NDArray[np.int64] | Floats
    mean: Floats
    low: Floats
    high: Floats

    @classmethod
    def of(cls, x: NDArray[np.int64] | Floats, samples: Floats, spread: Floats | None = None) -> Band:
        """Take mean and middle half over the first axis. NaN is no sample; where there is none, the band is NaN.

        A single sample off the others, such as one bad episode of hundreds, does not make the range.

        Args:
            x: positions on the horizontal axis, ``(n,)``.
            samples: what the mean is taken of, ``(n_samples, n)``.
            spread: what the range is taken of, ``(n_others, n)``; None takes ``samples``.
        """
        spread = np.asarray(samples if spread is None else spread, dtype=np.float64)
        is_known = ~np.isnan(spread).all(axis=0)
        ends = np.full((2, spread.shape[1]), np.nan)
        ends[:, is_known] = np.nanquantile(spread[:, is_known], MIDDLE_HALF, axis=0)
        return cls(x, mean_of_known(samples), *ends)
