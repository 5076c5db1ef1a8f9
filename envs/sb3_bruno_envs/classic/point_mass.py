"""Moves a point with inertia in a space of any dimension; subclasses say what it should do there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from sb3_bruno_envs.arguments import check_count
from sb3_bruno_envs.classic.painting import BLUE, GREEN, GREY, blank_image, paint

_TOP_SPEED = 0.3  # along an axis, per step
_RESPONSE = 0.5  # the share of the gap to the velocity asked for that closes in a step
_PIXELS_PER_UNIT = 50.0  # shows 1.28 units around the origin


class PointMassEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]], ABC):
    """Shows position and velocity ``(2 dim,)``; the action ``(dim,)``, clipped to [-1, 1], asks for a velocity.

    At 1 it asks for 0.3 units per step along an axis, and half of the gap to that closes in each step. An episode
    never terminates.

    Args:
        dim: dimension of the space.
        render_mode: None, or ``"rgb_array"`` for images ``(128, 128, 3)`` of the first two axes: the trail (grey), the
            task (green) and the point (blue), drawn without a graphics library.

    Raises:
        ValueError: if ``dim`` is no positive integer, or ``render_mode`` is neither.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # as Gymnasium has it

    def __init__(self, dim: int, render_mode: str | None = None) -> None:
        check_count("dim", dim)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode={render_mode!r} is not supported: use None or 'rgb_array'.")
        self.dim = dim
        self.render_mode = render_mode
        self.observation_space = Box(-np.inf, np.inf, (2 * dim,))
        self.action_space = Box(-1.0, 1.0, (dim,))
        self.velocity = np.zeros(dim)
        self.trail = [np.zeros(dim)]  # the positions of this episode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start at rest where ``start`` says; there are no options."""
        super().reset(seed=seed)
        self.velocity = np.zeros(self.dim)
        self.trail = [self.start()]
        return self.observation(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Move, and earn minus the distance to ``target``."""
        asked = self.applied(np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0))
        self.velocity = self.velocity + _RESPONSE * (_TOP_SPEED * asked - self.velocity)
        self.trail.append(self.trail[-1] + self.velocity)
        return self.observation(), -float(np.linalg.norm(self.trail[-1] - self.target())), False, False, {}

    def observation(self) -> NDArray[np.float32]:
        """Return position and velocity, ``(2 dim,)``."""
        return np.concatenate([self.trail[-1], self.velocity]).astype(np.float32)

    @abstractmethod
    def start(self) -> NDArray[np.float64]:
        """Draw the first position, ``(dim,)``."""

    @abstractmethod
    def target(self) -> NDArray[np.float64]:
        """Return where the point should be, ``(dim,)``."""

    def applied(self, action: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the action does, ``(dim,)``: itself, unless a subclass says otherwise."""
        return action

    def render(self) -> NDArray[np.uint8] | None:
        """Return the image, ``(128, 128, 3)``, or None without a render mode."""
        if self.render_mode is None:
            return None
        image = blank_image()
        for points, color, radius in (
            (np.stack(self.trail), GREY, 0),
            (self.target()[None], GREEN, 2),
            (self.trail[-1][None], BLUE, 2),
        ):
            shown = np.zeros((len(points), 2))
            shown[:, : min(self.dim, 2)] = points[:, :2]
            paint(image, shown, color, pixels_per_unit=_PIXELS_PER_UNIT, radius=radius)
        return image
