"""Draws prefixes of sequences, and transitions to predict from each, which came before its end or after."""

from __future__ import annotations

from typing import NamedTuple

import torch as th
from torch import Tensor
from torch.nn import functional as F

N_PREFIXES = 16
N_TARGETS = 32


class Drawn(NamedTuple):
    """What a loss scores of a batch of sequences, instead of every transition given every prefix.

    Attributes:
        prefixes: how many transitions are known, shape (batch, N_PREFIXES). The prefix of none is drawn as often as
            that of any other length.
        targets: which transitions to predict from each prefix, shape (batch, N_PREFIXES, N_TARGETS).
        counts: 1; 0 where nothing counts in a sequence, so that its targets are arbitrary, as ``targets``.
    """

    prefixes: Tensor
    targets: Tensor
    counts: Tensor

    def known(self, prefixes: Tensor) -> Tensor:
        """Take what belongs to the drawn prefixes: (batch, time + 1, dim) -> (batch, N_PREFIXES, dim)"""
        return prefixes[self._sequences(1), self.prefixes]

    def wanted(self, values: Tensor) -> Tensor:
        """Take what belongs to the drawn transitions: (batch, time, dim) -> (batch, N_PREFIXES, N_TARGETS, dim)"""
        return values[self._sequences(2), self.targets]

    def mean(self, scores: Tensor) -> Tensor:
        """Average scores, shape as ``targets``, over what counts: -> ()"""
        return (self.counts * scores).sum() / self.counts.sum().clamp(min=1)

    def _sequences(self, n_dims: int) -> Tensor:
        numbers = th.arange(len(self.targets), device=self.targets.device)
        return numbers.reshape(-1, *[1] * n_dims)


def draw(weights: Tensor) -> Drawn:
    """Draw with replacement, in proportion to the weights of transitions, shape (batch, time).

    Example: of weights 1 0 1, the prefixes 0, 1 and 3 are drawn (2 knows as much as 1), and the transitions 0 and 2.
    """
    nothing = weights.sum(dim=1, keepdim=True) == 0
    prefixes = th.multinomial(F.pad(weights, (1, 0), value=1.0), N_PREFIXES, replacement=True)
    targets = th.multinomial(weights + nothing, N_PREFIXES * N_TARGETS, replacement=True)
    targets = targets.unflatten(1, (N_PREFIXES, N_TARGETS))
    return Drawn(prefixes, targets, (~nothing)[..., None].to(weights).expand(targets.shape))
