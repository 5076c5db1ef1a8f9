"""A control: the mean of random features of the transitions, which nothing ever trains.

    belief = (mean_i relu(W (s_i, a_i, r_i, s'_i) + b), log(1 + n)), with W and b as they were drawn

How well an agent does with it tells how much of a belief's worth is in the transitions themselves, and needs no learned
encoder. What is random is drawn when the encoder is made, and saved with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, TypedDict

import torch as th
from torch import Tensor, nn
from torch.nn import functional as F

from sb3_bruno.encoders.base import TaskEncoder, Transitions
from sb3_bruno.encoders.choices import check_least


class RandomArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``RandomFeatures``."""

    n_features: int


class RandomMemory(NamedTuple):
    """What random features keep.

    Attributes:
        n: how many transitions were absorbed, shape (..., 1).
        total: the sum of their features, shape (..., n_features).
    """

    n: Tensor
    total: Tensor


class RandomFeatures(TaskEncoder[RandomMemory]):
    """Creates an untrained encoder. It has no loss, and no gradient reaches it.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        n_features: number of features.

    Raises:
        ValueError: if ``n_features`` is not positive.
    """

    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {"n_features": (16, 32, 64)}

    def __init__(self, observation_dim: int, action_dim: int, *, n_features: int = 32) -> None:
        super().__init__()
        check_least("n_features", n_features, 1)
        self.belief_dim = n_features + 1
        features = nn.Sequential(nn.Linear(2 * observation_dim + action_dim + 1, n_features), nn.ReLU())
        self.features = features.requires_grad_(False)

    def empty(self, batch_shape: tuple[int, ...] = ()) -> RandomMemory:
        zeros = next(self.parameters()).new_zeros(*batch_shape, self.belief_dim)
        return RandomMemory(zeros[..., :1], zeros[..., 1:])

    def absorb(self, memory: RandomMemory, transitions: Transitions) -> RandomMemory:
        return RandomMemory(memory.n + 1, memory.total + self.features(th.cat(transitions, dim=-1)))

    def prefixes(self, transitions: Transitions, weights: Tensor | None = None) -> RandomMemory:
        features = self.features(th.cat(transitions.blanked(weights), dim=-1))
        counted = th.ones_like(features[..., :1]) if weights is None else weights.unsqueeze(-1)
        totals = (counted, counted * features)
        return RandomMemory(*(F.pad(total.cumsum(dim=-2), (0, 0, 1, 0)) for total in totals))

    def belief(self, memory: RandomMemory) -> Tensor:
        mean = memory.total / th.where(memory.n > 0, memory.n, 1.0)
        return th.cat([mean, memory.n.log1p()], dim=-1)

    def count(self, memory: RandomMemory) -> Tensor:
        return memory.n
