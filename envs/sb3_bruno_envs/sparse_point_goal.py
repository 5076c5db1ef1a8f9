"""A point in the plane that is paid only near a hidden goal: what one episode finds out serves the next."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.painting import BLUE, GREEN, GREY, blank_image, paint

EPISODE_STEPS = 20  # just enough to sweep the half circle of goals once
GOAL_RADIUS = 0.3  # around the goal, where rewards are paid
_STEP = 0.15  # moved in one step at full speed
_START_STD = 0.02  # of each coordinate of the first position
_PIXELS_PER_UNIT = 40.0  # shows 1.6 units around the origin


class SparsePointGoalEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Find the hidden goal: reward ``1 - distance`` within 0.3 of it, else 0.

    The observation is the position ``(2,)``, the action the velocity ``(2,)`` in [-1, 1]; at 1 the point moves by
    0.15 per step. It starts near the origin; an episode is truncated after 20 steps and never terminates. With a
    goal on the unit circle's upper half, a sweep of that half finds it within one episode and is paid for half of
    it; a point that knows the goal is there after six steps. After the sparse-reward point robot of Rakelly et al.,
    *Efficient Off-Policy Meta-Reinforcement Learning via Probabilistic Context Variables* (2019), which is slower.

    Args:
        render_mode: None, or ``"rgb_array"`` for images ``(128, 128, 3)`` of the trail (grey), the point
            (blue), the goal and where it pays (green), drawn without a graphics library.

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
        self.goal = np.array([0.0, 1.0])
        self._trail = [np.zeros(2)]  # the positions of this episode

    def set_task(self, task: ArrayLike) -> None:
        """Set the goal from a task ``(2,)``, its position."""
        self.goal = np.array(task, dtype=np.float64)

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
        self._trail.append(self._trail[-1] + _STEP * velocity)
        distance = float(np.linalg.norm(self._trail[-1] - self.goal))
        reward = 1.0 - distance if distance <= GOAL_RADIUS else 0.0
        return self._position(), reward, False, len(self._trail) > EPISODE_STEPS, {}

    def render(self) -> NDArray[np.uint8] | None:
        """The image ``(128, 128, 3)``, or None without a render mode."""
        if self.render_mode is None:
            return None
        image = blank_image()
        paint(image, np.stack(self._trail), GREY, pixels_per_unit=_PIXELS_PER_UNIT)
        paint(image, self.goal + GOAL_RADIUS * _circle(), GREEN, pixels_per_unit=_PIXELS_PER_UNIT)
        paint(image, self.goal[None], GREEN, pixels_per_unit=_PIXELS_PER_UNIT, radius=1)
        paint(image, self._trail[-1][None], BLUE, pixels_per_unit=_PIXELS_PER_UNIT, radius=2)
        return image

    def _position(self) -> NDArray[np.float32]:
        return self._trail[-1].astype(np.float32)


def _circle() -> NDArray[np.float64]:
    """Points ``(n, 2)`` of the unit circle."""
    angles = np.linspace(0.0, 2.0 * np.pi, 100)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)
