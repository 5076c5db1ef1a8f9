"""Sound encoders of somebody else: one that has nothing to learn, and one that keeps a matrix."""

from typing import NamedTuple

import torch as th
from torch import Tensor
from torch.nn import functional as F

from sb3_bruno.encoders import TaskEncoder


class MeanReward(TaskEncoder):
    """Believes the mean reward so far. It has no parameters."""

    belief_dim = 1

    def __init__(self, observation_dim, action_dim):
        super().__init__()

    def empty(self, batch_shape=()):
        return th.zeros(*batch_shape, 1), th.zeros(*batch_shape, 1)

    def absorb(self, memory, transitions):
        n, total = memory
        return n + 1, total + transitions.rewards

    def prefixes(self, transitions, weights=None):
        rewards = transitions.blanked(weights).rewards
        counts = th.ones_like(rewards) if weights is None else weights.unsqueeze(-1)
        return tuple(F.pad(part.cumsum(dim=-2), (0, 0, 1, 0)) for part in (counts, counts * rewards))

    def belief(self, memory):
        n, total = memory
        return total / n.clamp(min=1)


class LinearMemory(NamedTuple):
    """Sums over transitions of x x^T, (..., dim, dim), and of x r, (..., dim)."""

    precision: Tensor
    shift: Tensor


class BayesianLinear(TaskEncoder):
    """Believes the weights of a linear model of the reward, w ~ N(0, I). Its posterior has these as its mean."""

    learns_from = "critic"

    def __init__(self, observation_dim, action_dim):
        super().__init__()
        self.belief_dim = observation_dim + 1
        self.factor = th.nn.Parameter(th.ones(self.belief_dim))

    def _summands(self, transitions):
        x = self.factor * F.pad(transitions.next_observations, (0, 1), value=1.0)
        return LinearMemory(x.unsqueeze(-1) * x.unsqueeze(-2), x * transitions.rewards)

    def empty(self, batch_shape=()):
        dim = self.belief_dim
        return LinearMemory(self.factor.new_zeros(*batch_shape, dim, dim), self.factor.new_zeros(*batch_shape, dim))

    def absorb(self, memory, transitions):
        return LinearMemory(*(kept + new for kept, new in zip(memory, self._summands(transitions), strict=True)))

    def prefixes(self, transitions, weights=None):
        precision, shift = self._summands(transitions.blanked(weights))
        if weights is not None:
            precision, shift = weights[..., None, None] * precision, weights[..., None] * shift
        return LinearMemory(
            F.pad(precision.cumsum(dim=-3), (0, 0, 0, 0, 1, 0)), F.pad(shift.cumsum(dim=-2), (0, 0, 1, 0))
        )

    def belief(self, memory):
        prior = th.eye(self.belief_dim, dtype=memory.precision.dtype)
        return th.linalg.solve(memory.precision + prior, memory.shift.unsqueeze(-1)).squeeze(-1)

    def posterior(self, memory):
        prior = th.eye(self.belief_dim, dtype=memory.precision.dtype)
        return th.distributions.MultivariateNormal(self.belief(memory), precision_matrix=memory.precision + prior)
