"""The half-cheetah that runs forward in a body it does not know: its physical parameters are hidden."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sb3_bruno_envs.mujoco.half_cheetah import MetaHalfCheetahEnv


class CheetahParamsEnv(MetaHalfCheetahEnv):
    """Run forward: reward ``x_velocity - ctrl_cost_weight * |action|^2``, whatever the body.

    A task ``(4,)`` holds factors by which the model's own numbers are multiplied, all 1 for HalfCheetah-v5:

    - 0, mass: every body's mass and rotational inertia (``body_mass``, ``body_inertia``), as a denser material;
    - 1, damping: every joint's (``dof_damping``); stiffness and armature stay as they are;
    - 2, friction: every geom's sliding friction (``geom_friction[:, 0]``), the floor's too; torsional and rolling
      friction have no effect in this model, whose contacts have ``condim=3``;
    - 3, strength: every actuator's gear (``actuator_gear``); below 0 the motors are mounted the wrong way round.

    Args:
        **kwargs: those of MetaHalfCheetahEnv.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.factors = np.ones(4)  # mass, damping, friction, strength

    def set_task(self, task: ArrayLike) -> None:
        """Write the model's numbers from a task ``(4,)``; the state of the episode stays.

        Raises:
            ValueError: if mass, damping or friction is not positive, a factor is not finite, or there are not four.
        """
        factors = np.array(task, dtype=np.float64)
        if factors.shape != (4,) or not (factors[:3] > 0.0).all() or not np.isfinite(factors).all():
            raise ValueError(f"task={task!r} is invalid: give four finite factors, the first three above 0.")
        self.factors = factors
        mass, damping, friction, strength = factors
        model, original = self.model, self.original_model  # factors of one task never meet those of another
        model.body_mass[:] = mass * original.body_mass
        model.body_inertia[:] = mass * original.body_inertia
        model.dof_damping[:] = damping * original.dof_damping
        model.geom_friction[:, 0] = friction * original.geom_friction[:, 0]
        model.actuator_gear[:] = strength * original.actuator_gear
        self.refresh_constants()

    def progress(self, x_velocity: float) -> float:
        """The forward velocity, m/s."""
        return x_velocity
