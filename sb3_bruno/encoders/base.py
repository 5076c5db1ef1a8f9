"""What the algorithm asks of a task encoder: statistics that absorb transitions, and the belief read off them.

Torch only. An encoder knows transitions, not environments, buffers or policies.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch as th
from torch import Tensor, nn
from torch.distributions import Distribution

Statistics = tuple[Tensor, ...]
"""What an encoder keeps of the transitions absorbed: tensors of shape (..., anything), batch dimensions first."""


class Transitions(NamedTuple):
    """A batch of transitions (s, a, r, s') in the form in which the agent observes them.

    :ivar observations: s, shape (..., observation_dim)
    :ivar actions: a, scaled to [-1, 1], shape (..., action_dim)
    :ivar rewards: r, shape (..., 1)
    :ivar next_observations: s', shape (..., observation_dim)
    """

    observations: Tensor
    actions: Tensor
    rewards: Tensor
    next_observations: Tensor


class Outcomes(NamedTuple):
    """Monte Carlo samples of what follows an action, in data space.

    :ivar rewards: shape (samples, ..., 1), or None where the encoder does not model rewards
    :ivar next_observations: shape (samples, ..., observation_dim), or None where it does not model them
    """

    rewards: Tensor | None
    next_observations: Tensor | None

    def mean(self) -> Outcomes:
        """The mean over the samples, shapes (..., dim)."""
        return Outcomes(*(None if one is None else one.mean(dim=0) for one in self))

    def quantile(self, q: float) -> Outcomes:
        """The q-quantile over the samples, each dimension by itself, shapes (..., dim)."""
        return Outcomes(*(None if one is None else one.quantile(q, dim=0) for one in self))


class TaskEncoder(nn.Module, ABC):
    """Infers the hidden task from transitions.

    Noise that augments the transitions is an argument. Without it, it is zero: so a belief is a function of the
    transitions, the same in training, rollouts and tests; only the bound draws noise.

    :ivar belief_dim: size of the vector that stands for the belief in the extended observation
    :ivar noise_dim: size of the noise that augments each transition, 0 for none
    :ivar shortest_sequence: how many transitions of a task ``bound`` needs at least
    """

    belief_dim: int
    noise_dim: int
    shortest_sequence: int = 1

    def draw_noise(self, batch_shape: tuple[int, ...]) -> Tensor:
        """Standard normal noise for as many transitions, shape (*batch_shape, noise_dim)."""
        like = next(self.parameters())
        return th.randn(*batch_shape, self.noise_dim, dtype=like.dtype, device=like.device)

    @abstractmethod
    def empty(self, batch_shape: tuple[int, ...] = ()) -> Statistics:
        """The statistics of no transitions: the prior."""

    @abstractmethod
    def absorb(self, statistics: Statistics, transitions: Transitions, noise: Tensor | None = None) -> Statistics:
        """The statistics after one more transition each. Transitions (..., dim), noise (..., noise_dim)."""

    @abstractmethod
    def prefixes(
        self, transitions: Transitions, noise: Tensor | None = None, weights: Tensor | None = None
    ) -> Statistics:
        """The statistics of the first 0, 1, ..., time transitions: (..., time, dim) -> (..., time + 1, ...).

        Of weights (..., time), 1 lets a transition count and 0 leaves it out; None: all count.
        """

    @abstractmethod
    def belief(self, statistics: Statistics) -> Tensor:
        """The belief as a vector for actor and critics, shape (..., belief_dim)."""

    @abstractmethod
    def posterior(self, statistics: Statistics) -> Distribution:
        """p(theta | transitions absorbed), batch shape (..., latent_dim)."""

    @abstractmethod
    def log_bayes_factor(self, statistics: Statistics, transitions: Transitions) -> Tensor:
        """log p(transition | nothing absorbed) - log p(transition | statistics), in nats: (..., dim) -> (...)

        Below 0 where the belief expected the transition better than the prior does, far above where the task is
        another.
        """

    @abstractmethod
    def bound(self, transitions: Transitions) -> Tensor:
        """The objective on sequences that each come from one task, (batch, time, dim): a scalar to maximise.

        A lower bound on log p(what is modelled | the rest), in nats per transition.
        """

    @abstractmethod
    def one_step_bounds(self, transitions: Transitions) -> Tensor:
        """A lower bound on log p(what is modelled | the rest, the transitions before) at every step, in nats.

        Of sequences that each come from one task: (..., time, dim) -> (..., time)
        """

    @abstractmethod
    def outcomes(
        self,
        statistics: Statistics,
        observations: Tensor,
        actions: Tensor,
        next_observations: Tensor | None,
        n_samples: int,
    ) -> Outcomes:
        """Samples of what follows ``actions`` at ``observations``, given the transitions absorbed.

        :raises ValueError: if the encoder predicts rewards given ``next_observations``, and these are None
        """

    @abstractmethod
    def diagnostics(self) -> dict[str, Tensor]:
        """Scalars worth a line in the log, by name: tensors of shape (), left on their device."""
