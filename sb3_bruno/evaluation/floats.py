"""Arrays of floats in which NaN means that there is no sample. Knows NumPy alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
"""An array of floats, of single or double precision."""


def mean_of_known(samples: Floats, axis: int = 0) -> Floats:
    """Return the mean over ``axis`` of what is not NaN, in double precision; NaN where nothing is left."""
    with np.errstate(invalid="ignore"):  # 0 / 0
        means: Floats = np.nansum(samples, axis=axis, dtype=np.float64) / (~np.isnan(samples)).sum(axis=axis)
    return means
