"""Refuses arguments of encoders that are none of their choices, or too small."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, get_args


def check_choice(name: str, value: object, choices: Any) -> None:
    """Refuse what cannot be chosen.

    Args:
        name: of the argument.
        value: what it was given.
        choices: a ``Literal`` of the values that there are.

    Raises:
        ValueError: naming the argument, its value and what there is.
    """
    known = get_args(choices)
    if value not in known:
        raise ValueError(f"`{name}` must be one of {', '.join(map(repr, known))}, got {value!r}.")


def check_least(name: str, value: float, least: float) -> None:
    """Refuse a number that is too small, or not finite, and True and False, which Python takes for 1 and 0.

    Raises:
        ValueError: naming the argument, its value and the least that it may be.
    """
    if isinstance(value, bool) or not least <= value < math.inf:
        raise ValueError(f"`{name}` must be finite and at least {least}, got {value!r}.")


def check_layers(name: str, sizes: Any) -> None:
    """Refuse all but the sizes of layers, each a positive integer.

    Raises:
        ValueError: naming the argument and its value.
    """
    is_list = isinstance(sizes, Sequence) and not isinstance(sizes, str)
    if not is_list or not all(type(size) is int and size >= 1 for size in sizes):  # isinstance takes True for 1
        raise ValueError(f"`{name}` must hold the size of each layer, such as (128, 128), got {sizes!r}.")
