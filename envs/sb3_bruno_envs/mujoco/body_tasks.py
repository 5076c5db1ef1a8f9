"""Draws hidden bodies as log factors, in the range that meta-RL papers use and beyond it; knows no robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from sb3_bruno_envs.family import Family
from sb3_bruno_envs.mujoco.hidden_body import HiddenBody
from sb3_bruno_envs.tasks import TaskDistribution, TaskSet

MASS, DAMPING, FRICTION = np.log(1.5), np.log(1.3), np.log(1.5)
"""Log factors of one unit. Papers draw -3 to 3 units: factors of 0.30 to 3.38, and 0.46 to 2.20 of damping."""

_USUAL, _WIDE = 3.0, 4.0  # units


def body_tasks(unit: NDArray[np.float64], n_train: int, n_test: int) -> TaskSet:
    """Draw bodies uniformly in the usual range, one after the other.

    Args:
        unit: the log factors of one unit, ``(dim,)``.
        n_train: the number of training tasks, the first.
        n_test: the number of test tasks, the next.
    """
    bodies = np.random.RandomState(1337).uniform(-_USUAL, _USUAL, (n_train + n_test, len(unit))) * unit
    return TaskSet(bodies[:n_train], bodies[n_train:], space=_box(_WIDE, unit), train_box=_box(_USUAL, unit))


def beyond(unit: NDArray[np.float64], tasks: TaskSet) -> TaskSet:
    """Return ``tasks`` with 20 test tasks of a wider range; at least one factor of each lies outside the usual one."""
    units = np.random.RandomState(1338).uniform(-_WIDE, _WIDE, (60, len(unit)))
    outside = units[(np.abs(units) > _USUAL).any(axis=1)][:20]
    return tasks.beyond(outside * unit)


def mass_gap(unit: NDArray[np.float64], n_bodies: int) -> TaskSet:
    """Return a split with a gap: one factor for all masses, small or large to train, in between to test.

    Kim et al.: *Task-Aware Virtual Training: Enhancing Generalization in Meta-Reinforcement Learning for
    Out-of-Distribution Tasks* (2025), whose training factors are other draws from the same ranges.

    Args:
        unit: the log factors of one unit, ``(dim,)``.
        n_bodies: the number of masses, which come first in a task.
    """
    rng = np.random.RandomState(1337)
    train = np.concatenate([rng.uniform(0.0, 0.5, 50), rng.uniform(3.0, 3.5, 50)])  # units
    test = np.array([0.75, 1.25, 1.75, 2.25, 2.75])
    masses = np.where(np.arange(len(unit)) < n_bodies, unit, 0.0)
    return TaskSet(np.outer(train, masses), np.outer(test, masses), space=_box(_WIDE, unit))


def _box(units: float, unit: NDArray[np.float64]) -> Box:
    """Return the Box of log factors up to so many units, ``(dim,)``."""
    high = (units * unit).astype(np.float32)
    return Box(-high, high)


class BodyFamily(Family):
    """Makes environments whose ``published`` says which tasks are their own; an episode has 200 steps.

    Args:
        env_class: a class with HiddenBody.
        tasks: the family's own tasks.
        task_sets: others by name.
        published_tasks: the tasks with ``published=True``, see HiddenBody.
    """

    def __init__(
        self, env_class: type[HiddenBody], tasks: TaskSet, *, task_sets: Mapping[str, TaskSet], published_tasks: TaskSet
    ) -> None:
        super().__init__(env_class, tasks, task_sets=task_sets, max_episode_steps=200)
        self.published_tasks = published_tasks

    def tasks_for(self, env_kwargs: Mapping[str, Any]) -> tuple[TaskDistribution, Mapping[str, TaskSet]]:
        """Return the tasks of ``published``, which have no named sets, or the family's own."""
        if env_kwargs.get("published", False):
            return self.published_tasks, {}
        return super().tasks_for(env_kwargs)
