"""Moves a point in the plane and paints it; subclasses say what it should do there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from sb3_bruno_envs.classic.painting import BLUE, GREEN, GREY, blank_image, paint


class PointEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]], ABC):
    """Shows the position ``(2,)`` and takes the velocity ``(2,)``, clipped to [-1, 1], as the action.

    A subclass says where the point starts and how far it moves, what a step earns, and what to paint of the task.

    Args:
        render_mode: None, or ``"rgb_array"`` for images ``(128, 128, 3)`` of the trail (grey), the task (green) and
            the point (blue), drawn without a graphics library.

    Raises:
        ValueError: if ``render_mode`` is neither.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # as Gymnasium has it
    start_std: float  # of each coordinate of the first position
    distance_per_step: float  # at full speed along an axis
    pixels_per_unit: float

    def __init__(self, render_mode: str | None = None) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode={render_mode!r} is not supported: use None or 'rgb_array'.")
        self.render_mode = render_mode
        self.observation_space = Box(-np.inf, np.inf, (2,))
        self.action_space = Box(-1.0, 1.0, (2,))
        self.trail = [np.zeros(2)]  # the positions of this episode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start near the origin; there are no options."""
        super().reset(seed=seed)
        self.trail = [self.start_std * self.np_random.standard_normal(2)]
        return self.position(), {}

    def move(self, action: NDArray[np.float32]) -> NDArray[np.float64]:
        """Move for a step and return the velocity, ``(2,)``."""
        velocity = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        self.trail.append(self.trail[-1] + self.distance_per_step * velocity)
        return velocity

    def position(self) -> NDArray[np.float32]:
        """Return the position of the point, ``(2,)``."""
        return self.trail[-1].astype(np.float32)

    @abstractmethod
    def task_points(self) -> NDArray[np.float64]:
        """Return points that show the task, ``(n, 2)``."""

    def render(self) -> NDArray[np.uint8] | None:
        """Return the image, ``(128, 128, 3)``, or None without a render mode."""
        if self.render_mode is None:
            return None
        image = blank_image()
        paint(image, np.stack(self.trail), GREY, pixels_per_unit=self.pixels_per_unit)
        paint(image, self.task_points(), GREEN, pixels_per_unit=self.pixels_per_unit)
        paint(image, self.trail[-1][None], BLUE, pixels_per_unit=self.pixels_per_unit, radius=2)
        return image
