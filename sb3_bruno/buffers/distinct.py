"""Draws places without repetition, in many pools at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.int64]
FEW = 4
"""A pool is small if it has fewer than so many places for each that is drawn."""


def distinct_places(sizes: Array, length: int, rng: np.random.Generator) -> Array:
    """Draw places 0, 1, ..., size - 1 uniformly, none of them twice; with replacement where ``size < length``.

    A small pool is shuffled whole. In a larger one, what repeats an earlier place is drawn again until nothing does.
    That treats all places alike, so every order of every ``length`` of them is equally likely.

    Args:
        sizes: of each pool, at least 1, (n,).
        length: how many places are drawn in each.
        rng: draws them.

    Returns:
        Places, (n, length).
    """
    places: Array = rng.integers(sizes[:, None], size=(len(sizes), length))
    enough, large = sizes >= length, sizes >= FEW * length
    small = enough & ~large
    if small.any():
        keys = rng.random((int(small.sum()), int(sizes[small].max())))
        keys[np.arange(keys.shape[1]) >= sizes[small, None]] = 1.0  # no place: behind all others
        places[small] = np.argsort(keys, axis=1)[:, :length]
    while (again := _repeats(places) & large[:, None]).any():
        places[again] = rng.integers(np.broadcast_to(sizes[:, None], places.shape)[again])
    return places


def _repeats(places: Array) -> NDArray[np.bool_]:
    """Tell which places (n, length) occur in their row already."""
    order = np.argsort(places, axis=1, kind="stable")
    ranked = np.take_along_axis(places, order, axis=1)
    repeats = np.zeros(places.shape, dtype=bool)
    np.put_along_axis(repeats, order[:, 1:], ranked[:, 1:] == ranked[:, :-1], axis=1)
    return repeats
