"""The half-cheetah that runs forward in a body it does not know: its physical parameters are hidden."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from sb3_bruno_envs.mujoco.half_cheetah import MetaHalfCheetahEnv, derive_constants

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


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
        model = self.model
        self._body_mass, self._body_inertia = model.body_mass.copy(), model.body_inertia.copy()
        self._dof_damping, self._actuator_gear = model.dof_damping.copy(), model.actuator_gear.copy()
        self._sliding_friction = model.geom_friction[:, 0].copy()

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
        # Always from the stored numbers: factors of one task never meet those of another.
        self.model.body_mass[:] = mass * self._body_mass
        self.model.body_inertia[:] = mass * self._body_inertia
        self.model.dof_damping[:] = damping * self._dof_damping
        self.model.geom_friction[:, 0] = friction * self._sliding_friction
        self.model.actuator_gear[:] = strength * self._actuator_gear
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        derive_constants(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, state, _STATE)
        mujoco.mj_forward(self.model, self.data)  # poses to render

    def progress(self, x_velocity: float) -> float:
        """The forward velocity, m/s."""
        return x_velocity

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Continue in the body of the pickled task; the model itself is built anew."""
        super().__setstate__(state)
        self.set_task(self.factors)
