"""Refuses numbers that would ruin what learns from them: NaN, infinities, and finite ones whose products overflow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

LARGEST = 1e9
"""Largest absolute value that is taken. A gradient is of the size of an input times an error, and Adam squares it:
(1e9 * 1e9)^2 is a number in float32, a hundred times more is infinite for good."""


NUMBER_KINDS = "biuf"
"""Kinds of NumPy's types that are taken for numbers: bool, integers, floats."""


def read_rows(name: str, given: ArrayLike, *shapes: tuple[int, ...]) -> NDArray[Any]:
    """Make an array of what was given, of one of several shapes. NumPy would store a single row for all envs.

    Args:
        name: of the argument, for the error.
        given: the rows.
        *shapes: those that it may have.

    Raises:
        ValueError: if it has another shape, or holds no numbers.
    """
    array = np.asarray(given)
    if array.shape not in shapes or array.dtype.kind not in NUMBER_KINDS:
        raise ValueError(
            f"`{name}` is of type {array.dtype} and shape {array.shape}: give numbers of shape {shapes[0]}."
        )
    return array


def check_numbers(arrays: Mapping[str, NDArray[Any]], place: Callable[[tuple[int, ...]], str]) -> None:
    """Refuse arrays that hold a number that cannot be learned from.

    Args:
        arrays: by the names that the user knows them by.
        place: says where an entry is, for the error: from its index to words such as "in env 2".

    Raises:
        ValueError: naming the array, the place and the number.
    """
    for name, array in arrays.items():
        good = np.abs(array) <= LARGEST  # NaN compares as False
        if good.all():
            continue
        index = tuple(int(i) for i in np.argwhere(~good)[0])
        raise ValueError(
            f"`{name}` is {array[index]:g} {place(index)}: numbers must be finite and at most {LARGEST:.0e} in size. "
            "Bound them in the env, or end the episode before."
        )


def place_in_env(index: tuple[int, ...]) -> str:
    """Say where an entry (env, ...) of a batch over envs is.

    Example:
        >>> place_in_env((2, 0))
        'in env 2, entry [0]'
    """
    return f"in env {index[0]}" + (f", entry {list(index[1:])}" if index[1:] else "")
