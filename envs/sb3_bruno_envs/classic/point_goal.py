"""Pays a point for being near a hidden goal: the simplest task of several dimensions."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.classic.point_mass import PointMassEnv, check_dim
from sb3_bruno_envs.family import Family
from sb3_bruno_envs.naming import place_name
from sb3_bruno_envs.tasks import TaskSet


class PointGoalEnv(PointMassEnv):
    """Rewards a point with inertia by minus its distance to the hidden goal.

    The observation is position and velocity ``(2 dim,)``, the action ``(dim,)`` in [-1, 1] asks for a velocity. The
    point starts near the origin. Each reward tells one number, and the goal has ``dim``.

    Args:
        dim: dimension of the space.
        render_mode: None, or ``"rgb_array"``; the goal is green.

    Raises:
        ValueError: if ``dim`` is not positive, or ``render_mode`` is neither.
    """

    def __init__(self, dim: int = 3, render_mode: str | None = None) -> None:
        super().__init__(dim, render_mode)
        self.goal = np.zeros(dim)

    def set_task(self, task: ArrayLike) -> None:
        """Set the goal from a task ``(dim,)``, its position."""
        self.goal = np.array(task, dtype=np.float64)

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the coordinates of the goal."""
        return f"goal {place_name(task)}"

    def start(self) -> NDArray[np.float64]:
        return 0.1 * self.np_random.standard_normal(self.dim)

    def target(self) -> NDArray[np.float64]:
        return self.goal


def point_goal_tasks(dim: int) -> TaskSet:
    """Return goals drawn uniformly from the cube [-1, 1]^dim: 100 to train, 20 others to test.

    Raises:
        ValueError: if ``dim`` is not positive.
    """
    check_dim(dim)
    goals = np.random.RandomState(1337).uniform(-1.0, 1.0, (120, dim))
    cube = Box(-1.0, 1.0, (dim,))
    return TaskSet(goals[:100], goals[100:], space=cube, train_box=cube)


class PointGoalFamily(Family):
    """Makes environments whose ``dim`` says which goals are their own."""

    def __call__(
        self, *, dim: int = 3, tasks: Any = None, task_space: Box | None = None, **kwargs: Any
    ) -> gym.Env[Any, Any]:
        """Make one environment; the arguments are those of Family and of PointGoalEnv."""
        own = point_goal_tasks(dim)
        return super().__call__(
            dim=dim,
            tasks=own if tasks is None else tasks,
            task_space=own.space if task_space is None else task_space,
            **kwargs,
        )


POINT_GOAL = PointGoalFamily(PointGoalEnv, point_goal_tasks(3), max_episode_steps=50)
