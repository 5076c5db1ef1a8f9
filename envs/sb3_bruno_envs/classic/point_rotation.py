"""Turns a point's actions by a hidden angle: the simplest hidden dynamics."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.classic.point_mass import PointMassEnv
from sb3_bruno_envs.family import Family
from sb3_bruno_envs.naming import direction_name
from sb3_bruno_envs.read_task import read_direction
from sb3_bruno_envs.tasks import TaskSet


class PointRotationEnv(PointMassEnv):
    """Rewards a point with inertia by minus its distance to the origin, and turns its actions by a hidden angle.

    The observation is position and velocity ``(4,)``, the action ``(2,)`` in [-1, 1] asks for a velocity, which is
    turned. The point starts anywhere in the square [-1, 1]^2.

    Args:
        render_mode: None, or ``"rgb_array"``; the origin is green.

    Raises:
        ValueError: if ``render_mode`` is neither.
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(2, render_mode)
        self.cos, self.sin = 1.0, 0.0

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return cosine and sine of the angle that a task ``(2,)`` names.

        Raises:
            ValueError: if these are of no angle.
        """
        return read_direction(task)

    def set_task(self, task: ArrayLike) -> None:
        """Set the angle from a task (see ``read_task``)."""
        self.cos, self.sin = self.read_task(task)

    task_entries = (("cosine", ""), ("sine", ""))

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the angle."""
        return direction_name(task)

    def applied(self, action: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn the action counterclockwise."""
        x, y = action
        return np.array([self.cos * x - self.sin * y, self.sin * x + self.cos * y])

    def start(self) -> NDArray[np.float64]:
        return self.np_random.uniform(-1.0, 1.0, 2)

    def target(self) -> NDArray[np.float64]:
        return np.zeros(2)


def _rotations(seed: int, n: int) -> NDArray[np.float64]:
    """Draw cosines and sines of uniform angles, ``(n, 2)``."""
    angles = np.random.RandomState(seed).uniform(0.0, 2.0 * np.pi, n)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


POINT_ROTATION_TASKS = TaskSet(_rotations(1337, 100), _rotations(1338, 20), space=Box(-1.0, 1.0, (2,)))
"""Cosine and sine of angles all around: 100 to train, 20 others to test."""

POINT_ROTATION = Family(PointRotationEnv, POINT_ROTATION_TASKS, max_episode_steps=50)
