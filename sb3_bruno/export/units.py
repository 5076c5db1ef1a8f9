"""Between the env's own units and what an agent observes, as torch modules that an exporter can follow."""

from __future__ import annotations

import numpy as np
import torch as th
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor, nn


class Normalize(nn.Module):
    """Creates VecNormalize's map of one key of the observation: (x - mean) / std, clipped, in float64 as there.

    Args:
        mean: shape (dim,).
        std: shape (dim,).
        clip: the largest result.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, mean: NDArray[np.float64], std: NDArray[np.float64], clip: float) -> None:
        super().__init__()
        self.register_buffer("mean", th.as_tensor(mean.ravel(), dtype=th.float64))
        self.register_buffer("std", th.as_tensor(std.ravel(), dtype=th.float64))
        self.clip = clip

    def forward(self, x: Tensor) -> Tensor:
        """Map x to what the agent observes, (..., dim) each."""
        return ((x.double() - self.mean) / self.std).clamp(-self.clip, self.clip).float()


def normalizer(vec_normalize: VecNormalize | None, key: str) -> nn.Module:
    """Make the map that an env's VecNormalize applies to a key of its observation; the identity where it applies none.

    Args:
        vec_normalize: with the statistics of its training; None: there is none.
        key: of the Dict of ``TransitionObservation``.
    """
    if vec_normalize is None or not vec_normalize.norm_obs or key not in (vec_normalize.norm_obs_keys or ()):
        return nn.Identity()
    statistics = vec_normalize.obs_rms[key]
    return Normalize(statistics.mean, np.sqrt(statistics.var + vec_normalize.epsilon), vec_normalize.clip_obs)


class ActionBounds(nn.Module):
    """Creates the two maps between an env's actions and [-1, 1].

    Args:
        space: the env's actions, bounded.
    """

    low: Tensor
    high: Tensor

    def __init__(self, space: spaces.Box) -> None:
        super().__init__()
        self.register_buffer("low", th.as_tensor(space.low.ravel(), dtype=th.float32))
        self.register_buffer("high", th.as_tensor(space.high.ravel(), dtype=th.float32))

    def scale(self, action: Tensor) -> Tensor:
        """Clip the env's actions and map them to [-1, 1], (..., dim) each, as ``TransitionObservation`` does."""
        clipped = th.minimum(th.maximum(action, self.low), self.high)
        return 2 / (self.high - self.low) * (clipped - self.low) - 1

    def unscale(self, scaled: Tensor) -> Tensor:
        """Map [-1, 1] to the env's actions, (..., dim) each, as SB3's policies do."""
        unscaled = self.low + 0.5 * (scaled + 1) * (self.high - self.low)
        return unscaled.clamp(self.low, self.high)  # which rounding may exceed
