"""Lets a network read the transitions of a sequence that count, one after the other, and nothing of the others."""

from __future__ import annotations

import torch as th
from torch import Tensor
from torch.nn import functional as F


def counted_first(x: Tensor, counted: Tensor) -> Tensor:
    """Move what counts to the front of each sequence, in its order: (batch, time, dim), (batch, time)

    Example: where 1 0 1 count, the result holds the transitions 0, 2 and then 1.
    """
    order = counted.argsort(dim=1, descending=True, stable=True)
    return x.gather(1, order.unsqueeze(-1).expand_as(x))


def prefixes_of_counted(states: Tensor, counted: Tensor) -> Tensor:
    """Look up the states after each prefix, where only what counts was read: (batch, time + 1, dim), (batch, time)

    Example: where 1 0 1 count, before step 0, 1, 2, 3 there counted 0, 1, 1, 2: of states s_0 ... s_3, the prefixes
    have s_0, s_1, s_1, s_2.
    """
    n_before = F.pad(counted.cumsum(dim=1), (1, 0)).unsqueeze(-1)
    return states.gather(1, n_before.expand(*n_before.shape[:2], states.shape[-1]))


def last_of_counted(states: Tensor, counted: Tensor) -> Tensor:
    """Look up the states after all that counts: (batch, time + 1, dim), (batch, time) -> (batch, dim)

    Example: where 1 0 1 count, s_2 of states s_0 ... s_3.
    """
    return states[th.arange(len(states), device=states.device), counted.sum(dim=1)]


def flat(x: Tensor, weights: Tensor | None) -> tuple[Tensor, Tensor | None]:
    """Give sequences (..., time, dim) one batch dimension, and say what counts of them.

    Returns:
        The sequences (batch, time, dim), and 1 where a transition's weight is above 0, else 0, (batch, time): a network
        that reads in order reads it once or not at all. None: all count.
    """
    sequences = x.flatten(end_dim=-3) if x.ndim > 2 else x.unsqueeze(0)
    if weights is None:
        return sequences, None
    return sequences, th.broadcast_to(weights > 0, x.shape[:-1]).reshape(sequences.shape[:2]).long()
