"""The matrix products of an update of SAC, and nothing else: no update on this core can take less time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import torch as th

from speed_sections.models import ACTION_DIM, OBSERVATION_DIM

Shape = tuple[int, int, int]


def matrix_products(batch: int, width: int = 256) -> Callable[[], None]:
    """Make a function that multiplies as an update of two critics must, which are constant where the actor learns."""
    actor = (OBSERVATION_DIM, width, width, 2 * ACTION_DIM)
    critic = (OBSERVATION_DIM + ACTION_DIM, width, width, 1)
    shapes = [*_forward(batch, actor)] * 2 + [*_weights(batch, actor), *_inputs(batch, actor[1:])]
    of_critic = [*_forward(batch, critic)] * 3  # the target's, of the data, of the actor's actions
    of_critic += [*_weights(batch, critic), *_inputs(batch, critic[1:]), *_inputs(batch, critic)]
    pairs = [(th.randn(m, k), th.randn(k, n), th.empty(m, n)) for m, k, n in shapes + 2 * of_critic]

    def multiply() -> None:
        for left, right, out in pairs:
            th.mm(left, right, out=out)

    return multiply


def _forward(batch: int, sizes: tuple[int, ...]) -> Iterator[Shape]:
    return ((batch, before, after) for before, after in pairwise(sizes))


def _weights(batch: int, sizes: tuple[int, ...]) -> Iterator[Shape]:
    """The gradient of the weights."""
    return ((before, batch, after) for before, after in pairwise(sizes))


def _inputs(batch: int, sizes: tuple[int, ...]) -> Iterator[Shape]:
    """The gradient of what a layer is given."""
    return ((batch, after, before) for before, after in pairwise(sizes))
