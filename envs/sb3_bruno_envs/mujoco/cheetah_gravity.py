"""Changes the gravity under which a half-cheetah should run forward; the gravity is hidden."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.family import Family
from sb3_bruno_envs.mujoco.half_cheetah import MetaHalfCheetahEnv
from sb3_bruno_envs.read_task import read_numbers
from sb3_bruno_envs.tasks import TaskSet

EARTH = 9.81  # m/s^2, the gravity of HalfCheetah-v5


class CheetahGravityEnv(MetaHalfCheetahEnv):
    """Rewards running forward under a hidden gravity: ``x_velocity - ctrl_cost_weight * |action|^2``.

    Under 9.81 m/s^2 it is HalfCheetah-v5 to the bit, the reward included: as published, this family keeps Gymnasium's
    cost of control. Luo et al.: *Adapt to Environment Sudden Changes by Learning a Context Sensitive Policy* (2022).
    Their episodes have 1,000 steps.

    Args:
        ctrl_cost_weight: weight of the squared torques.
        **kwargs: further keyword arguments of MetaHalfCheetahEnv.
    """

    def __init__(self, *, ctrl_cost_weight: float = 0.1, **kwargs: Any) -> None:
        super().__init__(ctrl_cost_weight=ctrl_cost_weight, **kwargs)

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return the gravity of a task ``(1,)``, in m/s^2.

        Raises:
            ValueError: if it is not one finite number above 0.
        """
        return read_numbers(task, 1, "the gravity in m/s^2", n_positive=1)

    def set_task(self, task: ArrayLike) -> None:
        """Set the gravity from a task (see ``read_task``); the state of the episode stays."""
        (gravity,) = self.read_task(task).astype(np.float32)
        factor = gravity / np.float32(EARTH)  # in the precision of tasks, so that it is 1 for Earth's
        self.model.opt.gravity[:] = float(factor) * self.original_model.opt.gravity

    task_entries = (("gravity", "m/s^2"),)

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the gravity."""
        return f"{np.asarray(task, dtype=np.float64).item():.4g} m/s^2"

    def progress(self, x_velocity: float) -> float:
        """Return the forward velocity, m/s."""
        return x_velocity


def _gravities(exponents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Earth's gravity times powers of 1.5, ``(n, 1)``."""
    return (EARTH * 1.5**exponents)[:, None]


def _between(low: float, high: float) -> Box:
    """Return the Box of all gravities with exponents in that range."""
    least, most = _gravities(np.array([low, high])).ravel().tolist()
    return Box(least, most, (1,))


_WITHIN = _gravities(np.random.RandomState(1337).uniform(-3.0, 3.0, 130))
_BEYOND = _gravities(np.random.RandomState(1338).uniform(3.0, 4.0, 20) * np.resize([-1.0, 1.0], 20))

CHEETAH_GRAVITY_TASKS = TaskSet(_WITHIN[:100], _WITHIN[100:], space=_between(-4.0, 4.0), train_box=_between(-3.0, 3.0))
"""Gravities in m/s^2, log-uniform from 9.81 / 1.5^3 to 9.81 * 1.5^3 (2.9 to 33.1): 100 to train, 30 others to test.

The exponents of ``tasks="beyond"``'s 20 test tasks are 3 to 4, every second one negative: [1.9, 2.9] and [33.1, 49.7].
"""

CHEETAH_GRAVITY = Family(
    CheetahGravityEnv,
    CHEETAH_GRAVITY_TASKS,
    task_sets={"beyond": CHEETAH_GRAVITY_TASKS.beyond(_BEYOND)},
    max_episode_steps=200,
)
