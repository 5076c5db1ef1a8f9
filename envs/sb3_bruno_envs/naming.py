"""What people call a task: directions and places in words. Knows no environment."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def direction_name(vector: ArrayLike) -> str:
    """Name a direction in the plane, ``(2,)``, by its angle: ``[0, 1]`` gives ``"90 degrees"``."""
    x, y = (float(value) for value in _round(vector, 6))
    return f"{math.degrees(math.atan2(y, x)) + 0.0:.4g} degrees"


def place_name(point: ArrayLike) -> str:
    """Name a point, ``(dim,)``, by its coordinates: ``[0.5, -1]`` gives ``"(0.5, -1)"``."""
    return f"({', '.join(f'{value:.4g}' for value in _round(point, 4))})"


def _round(values: ArrayLike, decimals: int) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64).round(decimals) + 0.0  # -0 becomes 0
