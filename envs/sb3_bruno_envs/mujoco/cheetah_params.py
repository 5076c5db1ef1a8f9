"""Changes the body of a half-cheetah that should run forward; the body is hidden."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.family import Family
from sb3_bruno_envs.mujoco.half_cheetah import MetaHalfCheetahEnv
from sb3_bruno_envs.mujoco.physics import scale_physics
from sb3_bruno_envs.read_task import read_numbers
from sb3_bruno_envs.tasks import TaskSet


class CheetahParamsEnv(MetaHalfCheetahEnv):
    """Rewards running forward in a hidden body: ``x_velocity - ctrl_cost_weight * |action|^2``.

    A task ``(4,)`` holds factors by which the model's own numbers are multiplied, all 1 for HalfCheetah-v5:

    - 0, mass: every body's mass and rotational inertia (``body_mass``, ``body_inertia``), as a denser material;
    - 1, damping: every joint's (``dof_damping``); stiffness and armature stay as they are;
    - 2, friction: every geom's sliding friction (``geom_friction[:, 0]``), the floor's too; torsional and rolling
      friction have no effect in this model, whose contacts have ``condim=3``;
    - 3, strength: every actuator's gear (``actuator_gear``); below 0 the motors turn the wrong way.

    Args:
        **kwargs: keyword arguments of MetaHalfCheetahEnv.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.factors = np.ones(4)  # mass, damping, friction, strength

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return the factors of mass, damping, friction and strength of a task ``(4,)``.

        Raises:
            ValueError: if mass, damping or friction is not positive, a factor is not finite, or there are not four.
        """
        return read_numbers(task, 4, "factors of mass, damping, friction and strength", n_positive=3)

    def set_task(self, task: ArrayLike) -> None:
        """Write the model's numbers from a task (see ``read_task``); the state of the episode stays."""
        self.factors = self.read_task(task)
        mass, damping, friction, strength = self.factors
        scale_physics(self, mass=mass, damping=damping, friction=friction, gear=strength)

    task_entries = (("mass", ""), ("damping", ""), ("friction", ""), ("strength", ""))

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the four factors."""
        mass, damping, friction, strength = np.asarray(task, dtype=np.float64).tolist()
        return f"mass {mass:.3g}, damping {damping:.3g}, friction {friction:.3g}, strength {strength:.3g}"

    def progress(self, x_velocity: float) -> float:
        """Return the forward velocity, m/s."""
        return x_velocity


# Exponents of 2. Motors stronger than the model's on joints damped less make MuJoCo's integrator diverge: at
# strength 2, damping 1/2 within seconds.
_LOW, _HIGH = np.array([-1.0, -1.0, -1.0, -1.0]), np.array([1.0, 1.0, 1.0, 0.0])
_MARGIN = (_HIGH - _LOW) / 4.0


def _bodies(seed: int, n: int, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Draw log-uniform factors, ``(n, 4)``; the motors of every second body, on average, turn the wrong way."""
    rng = np.random.RandomState(seed)
    factors = 2.0 ** rng.uniform(low, high, (n, 4))
    factors[:, 3] *= rng.choice([-1.0, 1.0], n)
    return factors


def _bodies_box(low: NDArray[np.float64], high: NDArray[np.float64]) -> Box:
    """Return the Box of all such factors; strength has either sign."""
    least = np.append(2.0 ** low[:3], -(2.0 ** high[3]))
    return Box(least.astype(np.float32), (2.0**high).astype(np.float32))


_TRAIN_BODIES = _bodies_box(_LOW, _HIGH)
_WITHIN = _bodies(1337, 120, _LOW, _HIGH)
_AROUND = _bodies(1338, 60, _LOW - _MARGIN, _HIGH + _MARGIN)
_BEYOND = [body for body in _AROUND if not _TRAIN_BODIES.contains(body.astype(np.float32))][:20]

CHEETAH_PARAMS_TASKS = TaskSet(
    _WITHIN[:100],
    np.concatenate([_WITHIN[100:], _BEYOND]),
    space=_bodies_box(_LOW - _MARGIN, _HIGH + _MARGIN),
    train_box=_TRAIN_BODIES,
)
"""Factors of mass, damping, friction and strength: 100 to train, 40 to test.

The training tasks and the first 20 test tasks are log-uniform in [1/2, 2], strength in [1/2, 1]. Strength is negative
in about half of the bodies: their motors turn the wrong way. The last 20 test tasks are log-uniform in a range half as
wide again, [0.354, 2.828] and [0.420, 1.189], and at least one factor of each lies outside the training range. Without
negative strengths, a policy that does not know the body does as well as one that does, also in ranges twice as wide
(docs/results.md).
"""

CHEETAH_PARAMS = Family(
    CheetahParamsEnv, CHEETAH_PARAMS_TASKS, task_sets={"beyond": CHEETAH_PARAMS_TASKS.beyond()}, max_episode_steps=200
)
