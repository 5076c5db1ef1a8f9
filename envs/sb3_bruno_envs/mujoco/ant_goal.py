"""Pays Gymnasium's ant for being near a hidden goal.

The physics are bit-identical to Ant-v5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.family import Family
from sb3_bruno_envs.mujoco.ant import MetaAntEnv
from sb3_bruno_envs.mujoco.hidden_direction import unit_vectors
from sb3_bruno_envs.naming import place_name
from sb3_bruno_envs.read_task import read_numbers
from sb3_bruno_envs.tasks import TaskSet


class AntGoalEnv(MetaAntEnv):
    """Rewards Ant-v5 with ``-|x - goal_x| - |y - goal_y| - 0.1 |action|^2 - 5e-4 |contact forces|^2``.

    A task ``(2,)`` is the goal, in m from the origin, near which the ant starts. Observations ``(29,)``: positions, x
    and y among them, and velocities, without contact forces. Actions ``(8,)`` in [-1, 1], 0.05 s per step. The episode
    never ends by itself.

    x and y are those that the next observation shows. The published code read the torso's position from where
    MuJoCo leaves it, one substep (0.01 s) earlier.

    Args:
        ctrl_cost_weight: weight of the squared torques.
        **kwargs: further keyword arguments of MetaAntEnv.
    """

    def __init__(self, *, ctrl_cost_weight: float = 0.1, **kwargs: Any) -> None:
        self.goal = np.zeros(2)  # m
        super().__init__(
            ctrl_cost_weight=ctrl_cost_weight,
            terminate_when_unhealthy=False,
            exclude_current_positions_from_observation=False,
            **kwargs,
        )

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return x and y of the goal of a task ``(2,)``, in m.

        Raises:
            ValueError: if it is not two finite numbers.
        """
        return read_numbers(task, 2, "x and y of the goal in m")

    def set_task(self, task: ArrayLike) -> None:
        """Set the goal from a task (see ``read_task``)."""
        self.goal = self.read_task(task)

    task_entries = (("goal x", "m"), ("goal y", "m"))

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the coordinates of the goal."""
        return f"goal {place_name(task)} m"

    def _get_rew(self, x_velocity: float, action: NDArray[np.float32]) -> tuple[float, dict[str, float]]:
        goal = -float(np.abs(self.data.qpos[:2] - self.goal).sum())
        control = self.control_cost(action)  # type: ignore[no-untyped-call]  # untyped in Gymnasium
        contact = self.contact_cost
        return goal - control - contact, {"reward_goal": goal, "reward_ctrl": -control, "reward_contact": -contact}


_RADIUS = 3.0  # m, of the disc that the goals lie in
_SQUARE = Box(-_RADIUS, _RADIUS, (2,))


def _goals(radii: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the goals ``(n, 2)`` of radii in m and angles in radians, each ``(n,)``."""
    return radii[:, None] * unit_vectors(angles)


def _in_the_disc() -> NDArray[np.float64]:
    """Draw 180 goals uniformly from the disc, ``(180, 2)``: first all angles, then all radii."""
    rng = np.random.RandomState(1337)
    angles = rng.uniform(0.0, 2.0 * np.pi, 180)
    return _goals(_RADIUS * np.sqrt(rng.uniform(0.0, 1.0, 180)), angles)


def _near_and_far() -> NDArray[np.float64]:
    """Draw 150 goals, ``(150, 2)``, 4 of 15 within 1 m of the origin and the others beyond 2.5 m."""
    rng = np.random.RandomState(1337)
    angles = rng.uniform(0.0, 2.0 * np.pi, 150)
    near = rng.uniform(0.0, 1.0, 150) < 4.0 / 15.0
    return _goals(np.where(near, rng.uniform(0.0, 1.0, 150), rng.uniform(2.5, _RADIUS, 150)), angles)


_DISC = _in_the_disc()

ANT_GOAL_TASKS = TaskSet(_DISC[:150], _DISC[150:], space=_SQUARE, train_box=_SQUARE)
"""Goals drawn uniformly from a disc of 3 m: 150 to train, 30 others to test."""

ANT_GOAL_TAVT_TASKS = TaskSet(
    _near_and_far(), 1.75 * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]), space=_SQUARE, train_box=_SQUARE
)
"""``tasks="tavt"``, from Kim et al. (2025): 150 goals within 1 m or beyond 2.5 m to train, 4 at 1.75 m to test."""

ANT_GOAL = Family(AntGoalEnv, ANT_GOAL_TASKS, task_sets={"tavt": ANT_GOAL_TAVT_TASKS}, max_episode_steps=200)
