"""Moves a point in the plane, which should go in a hidden direction: a toy that is learned in seconds."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.classic.painting import arrow
from sb3_bruno_envs.classic.point import PointEnv
from sb3_bruno_envs.family import Family
from sb3_bruno_envs.naming import direction_name
from sb3_bruno_envs.read_task import read_direction
from sb3_bruno_envs.tasks import TaskSet

_ACTION_COST = 0.05


class PointDirEnv(PointEnv):
    """Rewards motion in the hidden direction: ``direction . action - 0.05 |action|^2``.

    The observation is the position ``(2,)``, the action the velocity ``(2,)`` in [-1, 1], 0.1 s per step. The
    point starts near the origin; an episode never terminates.

    Args:
        render_mode: None, or ``"rgb_array"``; the direction is a green arrow.

    Raises:
        ValueError: if ``render_mode`` is neither.
    """

    start_std = 0.1
    distance_per_step = 0.1
    pixels_per_unit = 19.0  # shows 3.3 units around the origin; 30 steps at full speed cover 3

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        self.direction = np.array([1.0, 0.0])

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return the direction that a task ``(2,)`` names, a unit vector.

        Raises:
            ValueError: if it is none.
        """
        return read_direction(task)

    def set_task(self, task: ArrayLike) -> None:
        """Set the direction from a task (see ``read_task``)."""
        self.direction = self.read_task(task)

    task_entries = (("x", ""), ("y", ""))

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return ``"right"``, ``"left"``, ``"up"`` or ``"down"``, or the angle of another direction."""
        name = direction_name(task)
        return {"0 degrees": "right", "180 degrees": "left", "90 degrees": "up", "-90 degrees": "down"}.get(name, name)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Move at the velocity ``action``."""
        velocity = self.move(action)
        reward = self.direction @ velocity - _ACTION_COST * (velocity @ velocity)
        return self.position(), float(reward), False, False, {}

    def task_points(self) -> NDArray[np.float64]:
        """Return an arrow from the origin, ``(60, 2)``."""
        return arrow(self.direction)


POINT_DIR_TASKS = TaskSet([[-1.0, 0.0], [1.0, 0.0]], space=Box(-1.0, 1.0, (2,)))
"""Left and right, as unit vectors in the plane; train and test are the same. ``tasks`` may name others."""

POINT_DIR = Family(PointDirEnv, POINT_DIR_TASKS, max_episode_steps=30)
