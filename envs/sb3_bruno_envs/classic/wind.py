"""Blows a point in the plane off its course by a hidden wind: sparse rewards, and the cheapest hidden dynamics."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.classic.painting import arrow
from sb3_bruno_envs.classic.point import PointEnv
from sb3_bruno_envs.family import Family
from sb3_bruno_envs.naming import place_name
from sb3_bruno_envs.read_task import read_numbers
from sb3_bruno_envs.tasks import TaskSet

GOAL = np.array([0.0, 1.0])
GOAL_RADIUS = 0.03  # around the goal, where rewards are paid; less than a step


class WindEnv(PointEnv):
    """Rewards each step that ends at the goal (0, 1), within 0.03 of it, by 1; all others earn 0.

    The observation is the position ``(2,)``, the action the velocity ``(2,)`` in [-1, 1]; at 1 the point moves by 0.1
    per step, and the hidden wind moves it further: ``position + 0.1 action + wind``. It starts at the origin; an
    episode never terminates. To stay at the goal, the agent must cancel the wind.

    Ni, Eysenbach and Salakhutdinov have this environment, with the same winds: *Recurrent Model-Free RL Can Be a Strong
    Baseline for Many POMDPs* (2022). They store the first step at the goal as the last of its episode.

    Args:
        render_mode: None, or ``"rgb_array"``; the goal and the wind, ten times as long, are green.

    Raises:
        ValueError: if ``render_mode`` is neither.
    """

    start_std = 0.0
    distance_per_step = 0.1
    pixels_per_unit = 40.0  # shows 1.6 units around the origin

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        self.wind = np.zeros(2)

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return how far the wind of a task ``(2,)`` blows the point per step.

        Raises:
            ValueError: if it is not two finite numbers.
        """
        return read_numbers(task, 2, "x and y of the wind per step")

    def set_task(self, task: ArrayLike) -> None:
        """Set the wind from a task (see ``read_task``)."""
        self.wind = self.read_task(task)

    task_entries = (("wind x", ""), ("wind y", ""))

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the wind per step."""
        return f"wind {place_name(task)}"

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Move at the velocity ``action``, and with the wind."""
        self.move(action)
        self.trail[-1] = self.trail[-1] + self.wind
        reward = float(np.linalg.norm(self.trail[-1] - GOAL) <= GOAL_RADIUS)
        return self.position(), reward, False, False, {}

    def task_points(self) -> NDArray[np.float64]:
        """Return the goal and an arrow along the wind, ``(61, 2)``."""
        return np.concatenate([GOAL[None], arrow(10.0 * self.wind)])


_WINDS = np.random.RandomState(1337).uniform(-0.08, 0.08, (60, 2))
# The point can cancel 0.095. From ahead the wind stays below 0.08, against which the goal is 50 steps away.
_AROUND = np.random.RandomState(1338).uniform([-0.095, -0.08], 0.095, (200, 2))
_STRONGER = _AROUND[(np.abs(_AROUND) > 0.08).any(axis=1)][:20]

WIND_TASKS = TaskSet(_WINDS[:40], _WINDS[40:], space=Box(-0.1, 0.1, (2,)), train_box=Box(-0.08, 0.08, (2,)))
"""Winds, uniform in the square [-0.08, 0.08]^2: 40 to train, 20 others to test.

The 20 test tasks of ``tasks="beyond"`` blow harder than 0.08 along an axis, up to 0.095, and never so from ahead.
"""

WIND = Family(WindEnv, WIND_TASKS, task_sets={"beyond": WIND_TASKS.beyond(_STRONGER)}, max_episode_steps=75)
