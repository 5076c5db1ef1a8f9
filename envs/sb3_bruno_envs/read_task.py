"""Reads the numbers of a task that an environment is given, and refuses what is no task; knows no environment.

Tasks are stored as float32, so a task may come rounded to it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def read_numbers(task: ArrayLike, dim: int, what: str, *, n_positive: int = 0) -> NDArray[np.float64]:
    """Return a task of finite numbers, ``(dim,)``.

    Args:
        task: what the environment is given.
        dim: how many numbers a task holds.
        what: what they are, for the error, such as ``"x and y of the goal in m"``.
        n_positive: so many of them, the first, must be above 0.

    Raises:
        ValueError: if there are more or fewer, or if one, as float32, is not finite or not above 0 as it must be.
    """
    numbers = _as_array(task)
    with np.errstate(over="ignore"):
        stored = numbers.astype(np.float32)
    if stored.shape != (dim,) or not np.isfinite(stored).all() or not (stored[:n_positive] > 0.0).all():
        bounds = {0: "", dim: " and above 0"}.get(n_positive, f", and the first {n_positive} above 0")
        raise ValueError(f"task={task!r} is invalid: give {what}, of shape ({dim},), finite{bounds}.")
    return numbers


def read_direction(task: ArrayLike) -> NDArray[np.float64]:
    """Return a task that is a unit vector of the plane, ``(2,)``.

    Raises:
        ValueError: if it is none.
    """
    numbers = _as_array(task)
    if numbers.shape != (2,) or not abs(math.hypot(*numbers) - 1.0) < 1e-3:  # which is false for NaN, too
        raise ValueError(f"task={task!r} is no direction: give two numbers of length 1, such as [0.6, 0.8].")
    return numbers


def read_one_hot(task: ArrayLike, dim: int) -> int:
    """Return the place of the 1 in a one-hot task, ``(dim,)``.

    Raises:
        ValueError: if it is none.
    """
    numbers, choices = _as_array(task), np.eye(dim)
    if numbers.shape != (dim,) or numbers.tolist() not in choices.tolist():
        raise ValueError(f"task={task!r} is not one-hot: give one of {choices.astype(int).tolist()}.")
    return int(numbers.argmax())


def _as_array(task: ArrayLike) -> NDArray[np.float64]:
    """Return a copy of a task as an array; what is none becomes NaN without a shape, which is no task."""
    try:
        return np.array(task, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.array(np.nan)
