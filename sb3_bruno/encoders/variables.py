"""What BRUNO models of a transition, y, and what it models it given, x, both standardised."""

from __future__ import annotations

from typing import Literal, NamedTuple

import torch as th
from torch import Tensor, nn

from sb3_bruno.encoders.base import Transitions
from sb3_bruno.maths.standardize import Standardize

Modelled = Literal["rewards", "next_observations", "both"]


class Values(NamedTuple):
    """Standardised values of transitions. What is not modelled, or not given, has dimension 0.

    Attributes:
        here: (s, a), shape (..., observation_dim + action_dim).
        there: s', where rewards are modelled given where the action led, shape (..., observation_dim or 0).
        rewards: r, shape (..., 1 or 0).
        changes: s' - s, which given s has the density of s' and shows what a step does, (..., observation_dim or 0).
    """

    here: Tensor
    there: Tensor
    rewards: Tensor
    changes: Tensor

    @property
    def x(self) -> Tensor:
        """What is given, (s, a) or (s, a, s')."""
        return th.cat([self.here, self.there], dim=-1)

    @property
    def y(self) -> Tensor:
        """What is modelled, (r), (s' - s) or both."""
        return th.cat([self.rewards, self.changes], dim=-1)


class Variables(nn.Module):
    """Reads values off transitions and standardises them by running statistics.

    Args:
        observation_dim: dimension of s.
        action_dim: dimension of a.
        modelled: what y holds.
        condition_on_next: whether x holds s', if y holds r.

    Attributes:
        here_dim: dimension of (s, a).
        there_dim: dimension of s' in x, else 0.
        x_dim: dimension of x.
        reward_dim: 1 if y holds r, else 0.
        change_dim: dimension of s' - s in y, else 0.
        here: standardises (s, a).
        there: standardises s'.
        rewards: standardises r.
        changes: standardises s' - s.
    """

    def __init__(self, observation_dim: int, action_dim: int, modelled: Modelled, condition_on_next: bool) -> None:
        super().__init__()
        self.reward_dim = 0 if modelled == "next_observations" else 1
        self.change_dim = 0 if modelled == "rewards" else observation_dim
        self.there_dim = observation_dim if condition_on_next and self.reward_dim else 0
        self.here_dim = observation_dim + action_dim
        self.x_dim = self.here_dim + self.there_dim
        self.here = Standardize(self.here_dim)
        self.there = Standardize(self.there_dim)
        self.rewards = Standardize(self.reward_dim)
        self.changes = Standardize(self.change_dim)

    def forward(self, transitions: Transitions) -> Values:
        """Read standardised values off transitions (..., dim)."""
        here, there, rewards, changes = self._raw(transitions)
        return Values(self.here(here), self.there(there), self.rewards(rewards), self.changes(changes))

    def _raw(self, transitions: Transitions) -> Values:
        observations, actions, rewards, arrivals = transitions
        return Values(
            th.cat([observations, actions], dim=-1),
            arrivals[..., : self.there_dim],
            rewards[..., : self.reward_dim],
            (arrivals - observations)[..., : self.change_dim],
        )

    def update(self, transitions: Transitions, weights: Tensor | None = None) -> None:
        """Move the running statistics towards those of the transitions that count."""
        counted = ... if weights is None else weights > 0
        statistics = (self.here, self.there, self.rewards, self.changes)
        for standardize, column in zip(statistics, self._raw(transitions), strict=True):
            standardize.update(column[counted])

    def log_det(self, values: Values) -> Tensor:
        """Return the log-determinant of the map from y in the env's units to its standardised values, shape (...)."""
        return self.rewards.log_det(values.rewards) + self.changes.log_det(values.changes)
