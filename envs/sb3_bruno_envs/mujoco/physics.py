"""Scales masses, friction, gravity and motors of any MuJoCo environment; knows no task and no reward."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, TypeAlias

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

Scale: TypeAlias = float | Mapping[str, float]


def scale_physics(
    env: gym.Env[Any, Any],
    *,
    mass: Scale = 1.0,
    inertia: Scale = 1.0,
    damping: Scale = 1.0,
    friction: Scale = 1.0,
    gear: Scale = 1.0,
    gravity: float = 1.0,
) -> None:
    """Multiply the original numbers of a MuJoCo model, and compute anew what MuJoCo derives from them.

    Factors refer to the model as it was at the first call, which is kept as ``original_model`` in ``env.unwrapped``. So
    a call twice is the same as once, and what a call leaves out has its original value: ``scale_physics(env)`` restores
    the model to the bit. The state of the episode stays.

    Written by hand, ``body_mass`` alone leaves rotational inertias and derived constants (``dof_invweight0``,
    ``stat.meaninertia``, ...) as they were, and the simulation is that of no body.

    A factor is one for all, or a dict of some by their names in the model file, such as ``{"torso": 2.0}``.

    Args:
        env: a MuJoCo environment, with wrappers or without.
        mass: of bodies: mass and rotational inertia, as a denser material.
        inertia: of bodies: rotational inertia, beyond what ``mass`` does to it.
        damping: of joints: viscous damping.
        friction: of geoms: sliding friction. Of two geoms in contact MuJoCo takes the greater one.
        gear: of motors, by the joints that they drive: their strength; below 0 they turn the other way.
        gravity: of the world.

    Raises:
        TypeError: if ``env`` has no MuJoCo model.
        ValueError: if a factor is out of range or not finite, or a name is not in the model.

    Example:
        >>> env = gym.make("Walker2d-v5")
        >>> scale_physics(env, mass=2.0, friction={"floor": 0.5})
    """
    model, original = _models(env)
    masses = _factors("mass", mass, _bodies(model), above=0.0)
    inertias = _factors("inertia", inertia, _bodies(model), above=0.0)
    dampings = _factors("damping", damping, _joints(model, model.dof_jntid), least=0.0)
    frictions = _factors("friction", friction, [model.geom(i).name for i in range(model.ngeom)], least=0.0)
    gears = _factors("gear", gear, _joints(model, _driven(model)))
    gravities = _number("gravity", gravity)
    model.body_mass[:] = masses * original.body_mass
    model.body_inertia[:] = (masses * inertias)[:, None] * original.body_inertia
    model.dof_damping[:] = dampings * original.dof_damping
    model.geom_friction[:, 0] = frictions * original.geom_friction[:, 0]
    model.actuator_gear[:] = gears[:, None] * original.actuator_gear
    model.opt.gravity[:] = gravities * original.opt.gravity
    derive_constants(model)


def derive_constants(model: mujoco.MjModel) -> None:
    """Compute what MuJoCo's compiler derives from masses and gears, in the compiler's order, to the bit."""
    mujoco.mj_setConst(model, mujoco.MjData(model))  # it leaves the data in another state: not the environment's
    masses = model.body_mass[1:]  # kg; body 0 is the world
    model.stat.meanmass = masses.cumsum()[-1] / len(masses)
    model.stat.meaninertia = model.dof_M0.cumsum()[-1] / model.nv  # read by the solver; not set by mj_setConst


def _models(env: gym.Env[Any, Any]) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """Return the model of an environment, and the model as it was; copy that at the first call."""
    bare: Any = env.unwrapped
    model = getattr(bare, "model", None)
    if not isinstance(model, mujoco.MjModel):
        raise TypeError(f"env={env} has no MuJoCo model: give an environment whose `unwrapped.model` is an MjModel.")
    if not hasattr(bare, "original_model"):
        bare.original_model = copy.copy(model)
    return model, bare.original_model


def _bodies(model: mujoco.MjModel) -> list[str]:
    return [model.body(i).name for i in range(model.nbody)]


def _joints(model: mujoco.MjModel, ids: NDArray[np.int32]) -> list[str]:
    """Return the names of joints; that of joint -1 is empty."""
    return [model.joint(i).name if i >= 0 else "" for i in ids]


def _driven(model: mujoco.MjModel) -> NDArray[np.int32]:
    """Return the joint that each actuator drives, ``(n_actuators,)``; -1 where it drives something else."""
    drives_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    return np.where(drives_joint, model.actuator_trnid[:, 0], -1)


def _factors(
    name: str, scale: Scale, owners: list[str], *, above: float = -np.inf, least: float = -np.inf
) -> NDArray[np.float64]:
    """Return a factor for each number of the model, ``(n,)``, from the names of the parts that the numbers are of."""
    if not isinstance(scale, Mapping):
        return np.full(len(owners), _number(name, scale, above=above, least=least))
    known = [owner for owner in dict.fromkeys(owners) if owner]
    for part in scale:
        if part not in known:
            raise ValueError(f"{name} names {part!r}, which is not in the model: choose of {known}.")
    by_part = {part: _number(f"{name}[{part!r}]", scale[part], above=above, least=least) for part in scale}
    return np.array([by_part.get(owner, 1.0) for owner in owners])


def _number(name: str, factor: Any, *, above: float = -np.inf, least: float = -np.inf) -> float:
    """Return a factor as a number."""
    try:
        number = np.asarray(factor, dtype=np.float64).item()
    except (TypeError, ValueError):
        raise ValueError(
            f"{name}={factor!r} is not a number: give one factor, 1.0 for the original, or a dict of factors by name."
        ) from None
    if not (np.isfinite(number) and number > above and number >= least):
        allowed = "above 0" if above == 0.0 else "of at least 0" if least == 0.0 else "that is finite"
        raise ValueError(f"{name}={factor!r} is out of range: give a factor {allowed}, 1.0 for the original.")
    return number
