"""Says how people may choose an environment's task: from a few by name, as a direction, or by its numbers."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sb3_bruno.algorithms.task_estimate import FEW_TASKS
from sb3_bruno.task_names import task_labels
from sb3_bruno.zoo.environments import distribution_of, tasks_of


class FewTasks(NamedTuple):
    """Tasks to choose from, ``(n, task_dim)``, and what they are called."""

    tasks: NDArray[np.float32]
    labels: list[str]


class Direction(NamedTuple):
    """A unit vector of the plane, by its angle in degrees between two bounds: 150 and 210 are those around the left."""

    low: float
    high: float

    def task(self, degrees: float) -> NDArray[np.float32]:
        """Return the task of an angle, ``(2,)``."""
        return np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))], dtype=np.float32)

    def degrees(self, task: ArrayLike) -> float:
        """Return the angle of a task, or the nearer of the bounds."""
        middle = (self.low + self.high) / 2
        beside = math.remainder(_angles(np.asarray(task)).item() - middle, 360.0)
        return min(max(middle + beside, self.low), self.high)


class Entries(NamedTuple):
    """A task's numbers, each between two bounds, ``(task_dim,)``, and what they are called."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    labels: list[str]


class OnlyDrawn(NamedTuple):
    """Nothing to choose by: tasks have no bounds."""


_ALL_AROUND = 60.0  # degrees without a task, at most, where tasks go all around

TaskChoice: TypeAlias = FewTasks | Direction | Entries | OnlyDrawn


def find_choice(env: gym.Env[Any, Any]) -> TaskChoice | None:
    """Find how people may choose the task of an environment.

    Returns:
        None if the environment has no task, or but one.
    """
    if not env.has_wrapper_attr("task_space"):
        return None
    train = tasks_of(env, "train")
    known = _distinct([train, tasks_of(env, "test")])
    if 1 <= len(known) <= FEW_TASKS:
        return FewTasks(known, task_labels(known, _names(env, known))) if len(known) > 1 else None
    if len(train) and train.shape[1] == 2 and np.allclose(np.linalg.norm(train, axis=1), 1.0, atol=1e-3):
        return _directions(_angles(train))
    return _entries(env, train)


def can_draw(env: gym.Env[Any, Any]) -> bool:
    """Return whether the environment draws tasks, by a ``task_distribution``."""
    return hasattr(distribution_of(env), "draw")


def _directions(angles: NDArray[np.float64]) -> Direction:
    """Bound directions by the largest gap between them, or by nothing if they go all around.

    Example: 150, 170 and -150 degrees have a gap of 300 degrees behind -150, so they lie between 150 and 210.
    """
    angles = np.sort(angles)
    gaps = np.diff(angles, append=angles[0] + 360.0)  # behind each
    last = int(gaps.argmax())
    if gaps[last] < _ALL_AROUND:
        return Direction(-180.0, 180.0)
    low = float(angles[(last + 1) % len(angles)])
    return Direction(low, low + 360.0 - float(gaps[last]))


def _entries(env: gym.Env[Any, Any], train: NDArray[np.float32]) -> Entries | OnlyDrawn:
    """Bound each number by the training box, or where there is none by the space, or by the tasks themselves."""
    box = getattr(distribution_of(env), "train_box", env.get_wrapper_attr("task_space"))
    low, high = box.low.astype(np.float64), box.high.astype(np.float64)
    if len(train):
        low = np.where(np.isfinite(low), low, train.min(axis=0))
        high = np.where(np.isfinite(high), high, train.max(axis=0))
    return Entries(low, high, entry_labels(env, len(low))) if np.isfinite([low, high]).all() else OnlyDrawn()


def entry_labels(env: gym.Env[Any, Any], task_dim: int) -> list[str]:
    """Return what the numbers of a task are called, with their units: ``["speed (m/s)"]``."""
    told = env.get_wrapper_attr("task_entries") if env.has_wrapper_attr("task_entries") else None
    if told is None:
        return [f"task[{place}]" for place in range(task_dim)]
    return [f"{name} ({unit})" if unit else name for name, unit in told]


def _names(env: gym.Env[Any, Any], tasks: NDArray[np.float32]) -> list[str]:
    """Return what the environment calls tasks, ``""`` for nothing."""
    name_of = env.get_wrapper_attr("name_of") if env.has_wrapper_attr("name_of") else lambda task: None
    return [name_of(task) or "" for task in tasks]


def _distinct(sets: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Return the rows of all sets, each once, in their order."""
    rows = [row for tasks in sets for row in tasks]
    kept = {row.tobytes(): row for row in reversed(rows)}  # the first of equal rows
    return np.array([row for row in rows if row is kept[row.tobytes()]], dtype=np.float32)


def _angles(vectors: NDArray[Any]) -> NDArray[np.float64]:
    """Return the angles of vectors ``(..., 2)`` in degrees, from -180 to 180."""
    return np.asarray(np.rad2deg(np.arctan2(vectors[..., 1], vectors[..., 0])), dtype=np.float64)
