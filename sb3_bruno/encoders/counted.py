"""Lets a network read the transitions of a sequence that count, one after the other, and nothing of the others."""

from __future__ import annotations

import torch as th
from torch import Tensor
from torch.nn import functional as F


def counted_first(x: Tensor, weights: Tensor) -> Tensor:
    """Move what counts to the front of each sequence, in its order: (batch, time, dim), (batch, time)

    Example: of weights 1 0 1, the result holds the transitions 0, 2 and then 1.
    """
    order = weights.argsort(dim=1, descending=True, stable=True)
    return x.gather(1, order.unsqueeze(-1).expand_as(x))


def prefixes_of_counted(states: Tensor, weights: Tensor) -> Tensor:
    """Look up the states after each prefix, where only what counts was read: (batch, time + 1, dim), (batch, time)

    Example: of weights 1 0 1, before step 0, 1, 2, 3 there counted 0, 1, 1, 2: of states s_0 ... s_3, the prefixes have
    s_0, s_1, s_1, s_2.
    """
    n_before = F.pad(weights.long().cumsum(dim=1), (1, 0)).unsqueeze(-1)
    return states.gather(1, n_before.expand(*n_before.shape[:2], states.shape[-1]))


def flat(x: Tensor, weights: Tensor | None) -> tuple[Tensor, Tensor | None]:
    """Give sequences (..., time, dim) and their weights (..., time) one batch dimension."""
    sequences = x.reshape(-1, *x.shape[-2:])
    return sequences, None if weights is None else th.broadcast_to(weights, x.shape[:-1]).reshape(sequences.shape[:2])
