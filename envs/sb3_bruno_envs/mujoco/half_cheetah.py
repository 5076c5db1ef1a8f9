"""Gymnasium's half-cheetah with a reward that depends on a hidden task: a direction or a target velocity.

The physics are bit-identical to HalfCheetah-v5. The control cost is half of Gymnasium's, as meta-RL has it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any

import mujoco
import numpy as np
from gymnasium.envs.mujoco.half_cheetah_v5 import HalfCheetahEnv
from numpy.typing import ArrayLike, NDArray

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # all that the next step depends on, the solver's warm start too
_HANDLES = ("model", "data", "mujoco_renderer")  # belong to MuJoCo and OpenGL: built anew, never pickled


def derive_constants(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute what MuJoCo's compiler derives from the masses; leaves ``data`` in another state."""
    mujoco.mj_setConst(model, data)
    model.stat.meanmass = model.body_mass[1:].mean()  # kg; body 0 is the world
    model.stat.meaninertia = model.dof_M0.mean()  # read by the solver; not set by mj_setConst


class MetaHalfCheetahEnv(HalfCheetahEnv):
    """HalfCheetah-v5 whose reward is ``progress(x_velocity) - ctrl_cost_weight * |action|^2``.

    Subclasses say what progress is. Observations ``(17,)``, actions ``(6,)`` in [-1, 1], 0.05 s per step; an
    episode never terminates. Pickling is exact: a copy continues the episode bit by bit.

    Args:
        ctrl_cost_weight: weight of the squared torques.
        **kwargs: further keyword arguments of Gymnasium's HalfCheetahEnv. Unless ``camera_id`` or ``camera_name``
            says otherwise, the camera follows the cheetah, which would run out of the picture.
    """

    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}  # noqa: RUF012  # as Gymnasium has it

    def __init__(self, *, ctrl_cost_weight: float = 0.05, **kwargs: Any) -> None:
        if "camera_id" not in kwargs:
            kwargs.setdefault("camera_name", "track")
        self._constructor_kwargs = {"ctrl_cost_weight": ctrl_cost_weight, **kwargs}
        super().__init__(ctrl_cost_weight=ctrl_cost_weight, **kwargs)

    def progress(self, x_velocity: float) -> float:
        """The reward, in m/s, for running at ``x_velocity`` (m/s) in the current task."""
        raise NotImplementedError

    def _get_rew(self, x_velocity: float, action: NDArray[np.float32]) -> tuple[float, dict[str, float]]:
        forward = self.progress(x_velocity)
        control = self.control_cost(action)  # type: ignore[no-untyped-call]  # untyped in Gymnasium
        return forward - control, {"reward_forward": forward, "reward_ctrl": -control}

    def _initialize_simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Load the model without the deprecated ``settotalmass`` and scale the masses as it did.

        MuJoCo warns about the attribute and writes a log file into the working directory.
        """
        root = ElementTree.parse(self.fullpath).getroot()
        compiler = root.find("compiler")
        total_mass = None if compiler is None else compiler.attrib.pop("settotalmass", None)  # kg
        if total_mass is None:
            return super()._initialize_simulation()
        model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
        data = mujoco.MjData(model)
        mujoco.mj_setTotalmass(model, float(total_mass))
        derive_constants(model, data)
        frame = model.vis.global_  # the offscreen image, at least as large as the one to render
        frame.offwidth = max(frame.offwidth, self.width)
        frame.offheight = max(frame.offheight, self.height)
        return model, data

    def __getstate__(self) -> dict[str, Any]:
        """The plain attributes, and the physics as one vector; Gymnasium's own pickle loses the episode."""
        physics = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, physics, _STATE)
        attributes = {name: value for name, value in self.__dict__.items() if name not in _HANDLES}
        return {"attributes": attributes, "physics": physics}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(type(self)(**state["attributes"]["_constructor_kwargs"]).__dict__)
        self.__dict__.update(state["attributes"])
        mujoco.mj_setState(self.model, self.data, state["physics"], _STATE)
        mujoco.mj_forward(self.model, self.data)  # poses to render; changes nothing that the next step reads


class CheetahDirEnv(MetaHalfCheetahEnv):
    """Run in the hidden direction: reward ``direction * x_velocity - ctrl_cost_weight * |action|^2``."""

    direction = 1.0  # +1 forward, -1 backward

    def set_task(self, task: ArrayLike) -> None:
        """Set the direction from a one-hot task ``(2,)``: ``[1, 0]`` backward, ``[0, 1]`` forward."""
        backward, forward = np.asarray(task, dtype=np.float64).tolist()
        self.direction = forward - backward

    def progress(self, x_velocity: float) -> float:
        """The velocity in the direction to run in, m/s."""
        return self.direction * x_velocity


class CheetahVelEnv(MetaHalfCheetahEnv):
    """Run at the hidden velocity: reward ``-|x_velocity - velocity| - ctrl_cost_weight * |action|^2``."""

    velocity = 1.0  # m/s

    def set_task(self, task: ArrayLike) -> None:
        """Set the target velocity from a task ``(1,)``, in m/s."""
        (self.velocity,) = np.asarray(task, dtype=np.float64).tolist()

    def progress(self, x_velocity: float) -> float:
        """Minus the distance to the target velocity, m/s."""
        return -abs(x_velocity - self.velocity)
