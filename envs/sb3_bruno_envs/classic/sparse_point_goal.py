"""Pays a point in the plane only near a hidden goal, so that what an episode finds out serves the next."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.classic.point import PointEnv
from sb3_bruno_envs.family import Family
from sb3_bruno_envs.naming import direction_name
from sb3_bruno_envs.read_task import read_numbers
from sb3_bruno_envs.tasks import TaskSet

EPISODE_STEPS = 20  # just enough to sweep the half circle of goals once
GOAL_RADIUS = 0.5  # around the goal, where rewards are paid


class SparsePointGoalEnv(PointEnv):
    """Rewards the point near the hidden goal: ``1 - distance`` within 0.5 of it, else 0.

    The observation is the position ``(2,)``, the action the velocity ``(2,)`` in [-1, 1]; at 1 the point moves by
    0.15 per step. It starts near the origin; an episode is truncated after 20 steps and never terminates. If the goal
    is on the upper half of the unit circle, a sweep of that half finds it within one episode, and earns 0.6 of what a
    point earns that knows the goal from the start.

    PEARL's point is slower: it starts at the origin, moves by at most 0.1 per step and axis, and is paid within 0.2 of
    the goal. Its goals are ``tasks="pearl"``. Rakelly et al.: *Efficient Off-Policy Meta-Reinforcement Learning via
    Probabilistic Context Variables* (2019).

    Args:
        render_mode: None, or ``"rgb_array"``; the goal and where it pays are green.

    Raises:
        ValueError: if ``render_mode`` is neither.
    """

    start_std = 0.02
    distance_per_step = 0.15
    pixels_per_unit = 40.0  # shows 1.6 units around the origin

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        self.goal = np.array([0.0, 1.0])

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return the position of the goal that a task ``(2,)`` names.

        Raises:
            ValueError: if it is not two finite numbers.
        """
        return read_numbers(task, 2, "x and y of the goal")

    def set_task(self, task: ArrayLike) -> None:
        """Set the goal from a task (see ``read_task``)."""
        self.goal = self.read_task(task)

    task_entries = (("goal x", ""), ("goal y", ""))

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the angle of the goal, seen from the start."""
        return f"goal at {direction_name(task)}"

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Move at the velocity ``action``."""
        self.move(action)
        distance = float(np.linalg.norm(self.trail[-1] - self.goal))
        reward = 1.0 - distance if distance <= GOAL_RADIUS else 0.0
        return self.position(), reward, False, len(self.trail) > EPISODE_STEPS, {}

    def task_points(self) -> NDArray[np.float64]:
        """Return a circle around the goal, and the goal, ``(101, 2)``."""
        angles = np.linspace(0.0, 2.0 * np.pi, 100)
        circle = self.goal + GOAL_RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return np.concatenate([circle, self.goal[None]])


_HALF_DISC = Box(np.array([-1.0, 0.0], np.float32), np.array([1.0, 1.0], np.float32))


def _goals(n: int) -> NDArray[np.float64]:
    """Return the middles of ``n`` equal arcs of the upper half of the unit circle, ``(n, 2)``."""
    angles = (np.arange(n) + 0.5) * np.pi / n  # rad
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


SPARSE_POINT_GOAL_TASKS = TaskSet(_goals(40), _goals(20), space=_HALF_DISC)
"""Goals all along the upper half of the unit circle: 40 to train, and 20 in between to test."""

_PEARL_ANGLES = np.linspace(0.0, np.pi, 100)  # rad
_PEARL_GOALS = np.random.RandomState(1337).permutation(np.stack([np.cos(_PEARL_ANGLES), np.sin(_PEARL_ANGLES)], axis=1))

SPARSE_POINT_GOAL_PEARL_TASKS = TaskSet(_PEARL_GOALS[:80], _PEARL_GOALS[80:], space=_HALF_DISC, train_box=_HALF_DISC)
"""The goals of PEARL's sparse point robot, ``tasks="pearl"``: 80 to train, 20 to test, in the published order."""

SPARSE_POINT_GOAL = Family(
    SparsePointGoalEnv, SPARSE_POINT_GOAL_TASKS, task_sets={"pearl": SPARSE_POINT_GOAL_PEARL_TASKS}, n_episodes=3
)
