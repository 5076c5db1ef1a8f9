"""Pays a point for being near a hidden goal: the simplest task of several dimensions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.arguments import check_count
from sb3_bruno_envs.classic.point_mass import PointMassEnv
from sb3_bruno_envs.family import Family
from sb3_bruno_envs.naming import place_name
from sb3_bruno_envs.read_task import read_numbers
from sb3_bruno_envs.tasks import TaskSet


class PointGoalEnv(PointMassEnv):
    """Rewards a point with inertia by minus its distance to the hidden goal.

    The observation is position and velocity ``(2 dim,)``, the action ``(dim,)`` in [-1, 1] asks for a velocity. The
    point starts near the origin. Each reward tells one number, and the goal has ``dim``.

    PEARL's point differs: it has no inertia, shows its position alone, moves by at most 0.1 per step and axis, starts
    anywhere in the square [-1, 1]^2, and has 20 steps. Its goals are ``tasks="pearl"``, with ``dim=2``. Rakelly et al.:
    *Efficient Off-Policy Meta-Reinforcement Learning via Probabilistic Context Variables* (2019).

    Args:
        dim: dimension of the space.
        render_mode: None, or ``"rgb_array"``; the goal is green.

    Raises:
        ValueError: if ``dim`` is no positive integer, or ``render_mode`` is neither.
    """

    def __init__(self, dim: int = 3, render_mode: str | None = None) -> None:
        super().__init__(dim, render_mode)
        self.goal = np.zeros(dim)

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return the position of the goal that a task ``(dim,)`` names.

        Raises:
            ValueError: if it is not ``dim`` finite numbers.
        """
        return read_numbers(task, self.dim, "the position of the goal")

    def set_task(self, task: ArrayLike) -> None:
        """Set the goal from a task (see ``read_task``)."""
        self.goal = self.read_task(task)

    task_entries = (("goal x", ""), ("goal y", ""), ("goal z", ""))

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
        ValueError: if ``dim`` is no positive integer.
    """
    check_count("dim", dim)
    goals = np.random.RandomState(1337).uniform(-1.0, 1.0, (120, dim))
    cube = Box(-1.0, 1.0, (dim,))
    return TaskSet(goals[:100], goals[100:], space=cube, train_box=cube)


def _beyond(dim: int) -> TaskSet:
    """Return the same goals to train, and 20 to test from the cube [-1.5, 1.5]^dim that lie outside [-1, 1]^dim."""
    around = np.random.RandomState(1338).uniform(-1.5, 1.5, (200, dim))
    outside = around[(np.abs(around) > 1.0).any(axis=1)][:20]
    return point_goal_tasks(dim).beyond(outside, space=Box(-1.5, 1.5, (dim,)))


_PLANE = Box(-1.0, 1.0, (2,))
_PEARL_GOALS = np.random.RandomState(1337).uniform(-1.0, 1.0, (100, 2))

POINT_GOAL_PEARL_TASKS = TaskSet(_PEARL_GOALS[:80], _PEARL_GOALS[80:], space=_PLANE, train_box=_PLANE)
"""The goals of PEARL's point robot, ``tasks="pearl"`` with ``dim=2``: 80 to train, 20 to test."""


class PointGoalFamily(Family):
    """Makes environments whose ``dim`` says which goals are their own."""

    def tasks_for(self, env_kwargs: Mapping[str, Any]) -> tuple[TaskSet, Mapping[str, TaskSet]]:
        """Return the goals of that dimension. Those that are published lie in the plane."""
        dim = env_kwargs.get("dim", 3)
        published = {"pearl": POINT_GOAL_PEARL_TASKS} if dim == 2 else {}
        return point_goal_tasks(dim), {"beyond": _beyond(dim), **published}

    def named(self, name: str, task_sets: Mapping[str, TaskSet]) -> TaskSet:
        """Return the task set of that name."""
        if name == "pearl" and name not in task_sets:
            raise ValueError("tasks='pearl' are goals in the plane: give dim=2 too.")
        return super().named(name, task_sets)


POINT_GOAL = PointGoalFamily(PointGoalEnv, point_goal_tasks(3), max_episode_steps=50)
