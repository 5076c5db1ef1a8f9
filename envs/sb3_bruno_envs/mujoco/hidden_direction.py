"""Pays a walking robot for its velocity in a hidden direction of the plane; knows no particular robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.mujoco.exact_state import ExactState
from sb3_bruno_envs.naming import direction_name
from sb3_bruno_envs.read_task import read_direction
from sb3_bruno_envs.tasks import TaskSet


class HiddenDirection(ExactState):
    """Pays the velocity in a hidden direction where Gymnasium pays the velocity in x; all other terms stay.

    Put it before Gymnasium's class, whose steps report both velocities. ``info["velocity_in_direction"]`` is the
    velocity that is paid, in m/s.

    Args:
        **kwargs: keyword arguments of Gymnasium's class.
    """

    _forward_reward_weight: float  # of Gymnasium's class

    def __init__(self, **kwargs: Any) -> None:
        self.direction = np.array([1.0, 0.0])  # a unit vector
        super().__init__(**kwargs)

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
        """Return ``"forward"``, ``"backward"``, ``"left"`` or ``"right"``, or the angle of another direction."""
        name = direction_name(task)
        return {"0 degrees": "forward", "180 degrees": "backward", "90 degrees": "left", "-90 degrees": "right"}.get(
            name, name
        )

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], np.float64, bool, bool, dict[str, np.float64]]:
        """Step the robot, and put the reward together anew."""
        observation, _, terminated, truncated, info = super().step(action)
        velocity = np.float64(self.direction @ [info["x_velocity"], info["y_velocity"]])
        forward = self._forward_reward_weight * velocity
        # Gymnasium's order of sums: in the direction of x this is Gymnasium's reward to the bit.
        reward = (forward + info["reward_survive"]) + (info["reward_ctrl"] + info["reward_contact"])
        info |= {"reward_forward": forward, "velocity_in_direction": velocity}
        return observation, reward, terminated, truncated, info


def unit_vectors(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the directions of angles ``(n,)`` in radians, as unit vectors ``(n, 2)``."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


DIRECTIONS = Box(-1.0, 1.0, (2,))
"""Holds all unit vectors of the plane."""

_ALL_AROUND = unit_vectors(np.random.RandomState(1337).uniform(0.0, 2.0 * np.pi, 130))

ALL_AROUND_TASKS = TaskSet(_ALL_AROUND[:100], _ALL_AROUND[100:], space=DIRECTIONS, train_box=DIRECTIONS)
"""Unit vectors all around the circle: 100 to train, 30 others to test."""
