"""The extended observation [observation | belief | task]: one flat vector, laid out here and nowhere else."""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor

CriticInput = Literal["task", "belief", "both"]


class ExtendedObs:
    """Lays out the extended observation.

    Example: an observation of 17, a belief of 10 and a task of 2 numbers make slices 0:17, 17:27 and 27:29. The
    actor reads 0:27; critics on the task read 0:17 and 27:29.

    Args:
        observation_dim: size of the flattened observation.
        belief_dim: size of the belief vector.
        task_dim: size of the task vector.
    """

    def __init__(self, observation_dim: int, belief_dim: int, task_dim: int) -> None:
        self.observation = slice(0, observation_dim)
        self.belief = slice(observation_dim, observation_dim + belief_dim)
        self.task = slice(self.belief.stop, self.belief.stop + task_dim)
        self.dim = self.task.stop

    @property
    def space(self) -> spaces.Box:
        """The space of extended observations, shape (dim,)."""
        return spaces.Box(-np.inf, np.inf, (self.dim,), np.float32)

    @property
    def actor_slices(self) -> list[slice]:
        """Observation and belief: never the task."""
        return [slice(0, self.belief.stop)]

    def critic_slices(self, critic_input: CriticInput) -> list[slice]:
        """Tell what critics read beside the action.

        Raises:
            ValueError: if ``critic_input`` is not 'task', 'belief' or 'both'.
        """
        slices = {
            "task": [self.observation, self.task],
            "belief": [slice(0, self.belief.stop)],
            "both": [slice(0, self.dim)],
        }
        if critic_input not in list(slices):  # which may be of a kind without a hash
            raise ValueError(f"`critic_input` must be 'task', 'belief' or 'both', got {critic_input!r}.")
        return slices[critic_input]

    def join(self, observation: Tensor, belief: Tensor, task: Tensor | None = None) -> Tensor:
        """Join (..., observation_dim), (..., belief_dim), (..., task_dim): (..., dim). No task: zeros stand for it."""
        if task is None:
            task = observation.new_zeros(*observation.shape[:-1], self.dim - self.task.start)
        return th.cat([observation, belief, task], dim=-1)


class SliceExtractor(BaseFeaturesExtractor):
    """Reads given slices of the extended observation: (batch, dim) -> (batch, features_dim).

    Args:
        observation_space: the space of extended observations.
        slices: slices to read, in order.
    """

    def __init__(self, observation_space: spaces.Box, slices: list[slice]) -> None:
        super().__init__(observation_space, features_dim=sum(part.stop - part.start for part in slices))
        self.slices = slices

    def forward(self, observations: Tensor) -> Tensor:
        parts = [observations[:, part] for part in self.slices]
        return parts[0] if len(parts) == 1 else th.cat(parts, dim=1)
