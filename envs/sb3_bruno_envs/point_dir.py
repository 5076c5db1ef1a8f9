"""A point in the plane that should move in a hidden direction: a toy in NumPy alone, learned in seconds."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.painting import BLUE, GREEN, GREY, blank_image, paint

_DT = 0.1  # s
_ACTION_COST = 0.05
_START_STD = 0.1  # of each coordinate of the first position
_PIXELS_PER_UNIT = 19.0  # shows 3.3 units around the origin; 30 steps at full speed cover 3


class PointDirEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Move in the hidden direction: reward ``direction . action - 0.05 |action|^2``.

    The observation is the position ``(2,)``, the action the velocity ``(2,)`` in [-1, 1], 0.1 s per step. The
    point starts near the origin; an episode never terminates.

    Args:
        render_mode: None, or ``"rgb_array"`` for images ``(128, 128, 3)`` of the trail (grey), the point
            (blue) and the direction (green arrow), drawn without a graphics library.

    Raises:
        ValueError: if ``render_mode`` is neither.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # as Gymnasium has it

    def __init__(self, render_mode: str | None = None) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode={render_mode!r} is not supported: use None or 'rgb_array'.")
        self.render_mode = render_mode
        self.observation_space = Box(-np.inf, np.inf, (2,))
        self.action_space = Box(-1.0, 1.0, (2,))
        self.direction = np.array([1.0, 0.0])
        self._trail = [np.zeros(2)]  # the positions of this episode

    def set_task(self, task: ArrayLike) -> None:
        """Set the direction from a task ``(2,)``, a unit vector."""
        self.direction = np.array(task, dtype=np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start near the origin; there are no options."""
        super().reset(seed=seed)
        self._trail = [_START_STD * self.np_random.standard_normal(2)]
        return self._position(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Move at the velocity ``action``, clipped to [-1, 1]."""
        velocity = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        self._trail.append(self._trail[-1] + _DT * velocity)
        reward = self.direction @ velocity - _ACTION_COST * (velocity @ velocity)
        return self._position(), float(reward), False, False, {}

    def render(self) -> NDArray[np.uint8] | None:
        """The image ``(128, 128, 3)``, or None without a render mode."""
        if self.render_mode is None:
            return None
        image = blank_image()
        paint(image, np.stack(self._trail), GREY, pixels_per_unit=_PIXELS_PER_UNIT)
        paint(image, _arrow(self.direction), GREEN, pixels_per_unit=_PIXELS_PER_UNIT)
        paint(image, self._trail[-1][None], BLUE, pixels_per_unit=_PIXELS_PER_UNIT, radius=2)
        return image

    def _position(self) -> NDArray[np.float32]:
        return self._trail[-1].astype(np.float32)


def _arrow(tip: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points ``(n, 2)`` of an arrow from the origin to ``tip``."""
    shaft = np.linspace(0.0, 1.0, 40)[:, None] * tip
    back, side = -tip, np.array([-tip[1], tip[0]])
    barb = np.linspace(0.0, 0.25, 10)[:, None]
    return np.concatenate([shaft, tip + barb * (back + side), tip + barb * (back - side)])
