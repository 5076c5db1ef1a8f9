"""What people call a task and its numbers: directions and places in words. Knows no environment."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def direction_name(vector: ArrayLike) -> str:
    """Name a direction in the plane, ``(2,)``, by its angle: ``[0, 1]`` gives ``"90 degrees"``."""
    x, y = (float(value) for value in _round(vector, 6))
    return f"{math.degrees(math.atan2(y, x)) + 0.0:.4g} degrees"


def place_name(point: ArrayLike, decimals: int = 4) -> str:
    """Name a point, ``(dim,)``, by its coordinates: ``[0.5, -1]`` gives ``"(0.5, -1)"``."""
    return f"({', '.join(f'{value:.{decimals}g}' for value in _round(point, decimals))})"


def check_entries(entries: Any) -> None:
    """Raise a ValueError unless ``task_entries`` are name and unit of each number of a task."""
    if not isinstance(entries, list | tuple) or not all(map(_is_entry, entries)):
        raise ValueError(
            f"task_entries={entries!r} is no list of pairs of name and unit: give such as [('velocity', 'm/s')]."
        )


def _is_entry(entry: Any) -> bool:
    return isinstance(entry, list | tuple) and len(entry) == 2 and all(isinstance(text, str) for text in entry)


def _round(values: ArrayLike, decimals: int) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64).round(decimals) + 0.0  # -0 becomes 0
