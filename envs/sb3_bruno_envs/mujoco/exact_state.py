"""Pickles Gymnasium's MuJoCo environments exactly, changed bodies included, and draws them wherever they run.

Knows no reward and no task.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from typing import Any, TypeAlias

import mujoco
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv
from numpy.typing import NDArray

from sb3_bruno_envs.mujoco.endless_floor import endless_floor
from sb3_bruno_envs.mujoco.physics import derive_constants

Numbers: TypeAlias = dict[str, NDArray[Any]]  # of a MuJoCo struct, by the name of their field

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # all that the physics of the next step depend on, the warm start too
_HANDLES = ("model", "data", "mujoco_renderer", "original_model")  # MuJoCo's and OpenGL's: built anew, never pickled


class ExactState(MujocoEnv):
    """Continues a pickled episode bit for bit, in the same body; Gymnasium's own pickle begins a new one.

    Put it before Gymnasium's class, and give its constructor keyword arguments only:

        >>> class HeavyAntEnv(ExactState, AntEnv):
        ...     def __init__(self, factor, **kwargs):
        ...         super().__init__(**kwargs)
        ...         scale_physics(self, mass=factor)

    A pickle holds the attributes, the state of the physics, what the last step left in ``data``, and the numbers of
    the model that changed since it was built. Do not keep views of ``model`` or ``data`` in attributes: a copy's views
    would not follow its own simulation.

    Images have a floor without an end, and the camera called "track" follows the robot, which would run out of the
    picture. All of Gymnasium's robots have one.

    Args:
        **kwargs: keyword arguments of Gymnasium's class, ``camera_id`` or ``camera_name`` for another camera among
            them. A copy builds model and renderer from them.
    """

    original_model: mujoco.MjModel
    """The model as it was built. Compute changed numbers from its numbers, so that changes never add up."""

    def __init__(self, **kwargs: Any) -> None:
        if "camera_id" not in kwargs:
            kwargs.setdefault("camera_name", "track")
        self._constructor_kwargs = kwargs
        super().__init__(**kwargs)

    def _initialize_simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Load the model without the deprecated ``settotalmass`` and scale the masses as it did.

        MuJoCo warns about the attribute and writes a log file into the working directory.
        """
        root = ElementTree.parse(self.fullpath).getroot()
        compiler = root.find("compiler")
        total_mass = None if compiler is None else compiler.attrib.pop("settotalmass", None)  # kg
        if total_mass is None:
            model, data = super()._initialize_simulation()
        else:
            model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
            data = mujoco.MjData(model)
            mujoco.mj_setTotalmass(model, float(total_mass))
            derive_constants(model)
            frame = model.vis.global_  # the offscreen image, at least as large as the one to render
            frame.offwidth = max(frame.offwidth, self.width)
            frame.offheight = max(frame.offheight, self.height)
        self.original_model = copy.copy(model)
        return model, data

    def render(self) -> Any:
        """Render as Gymnasium does, on a floor that has no end."""
        with endless_floor(self.model, self.data):
            return super().render()  # type: ignore[no-untyped-call]  # untyped in Gymnasium

    def refresh_constants(self) -> None:
        """Compute what follows from changed numbers of the model; the state of the episode stays.

        ``scale_physics`` has done so already.
        """
        derive_constants(self.model)

    def _physics(self) -> NDArray[np.float64]:
        """Return the state of the physics, ``(state_dim,)``."""
        physics = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, physics, _STATE)
        return physics

    def __getstate__(self) -> dict[str, Any]:
        """Return all that a copy cannot build from the constructor's arguments."""
        parts = zip(_parts(self.model), _parts(self.original_model), strict=True)
        return {
            "attributes": {name: value for name, value in self.__dict__.items() if name not in _HANDLES},
            "physics": self._physics(),
            # The next reward of the ant and of the humanoid starts from these positions, and they lag behind the state.
            "left_by_the_last_step": {
                name: value for name, value in _numbers(self.data).items() if value.dtype == np.float64
            },
            "changed": [_changed(part, original) for part, original in parts],
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Build model and renderer anew, then write what the pickle holds; no subclass's constructor runs."""
        self.__dict__.update(state["attributes"])
        ExactState.__init__(self, **state["attributes"]["_constructor_kwargs"])
        self.__dict__.update(state["attributes"])
        for part, changed in zip(_parts(self.model), state["changed"], strict=True):
            _write(part, changed)
        mujoco.mj_setState(self.model, self.data, state["physics"], _STATE)
        mujoco.mj_forward(self.model, self.data)  # contacts to look at; the next step computes them again
        _write(self.data, state["left_by_the_last_step"])


def _parts(model: mujoco.MjModel) -> tuple[Any, ...]:
    """Return the structs that hold a model's numbers: itself, its options, its statistics."""
    return model, model.opt, model.stat


def _numbers(part: Any) -> Numbers:
    """Return copies of all numbers that can be written. Those of contacts cannot: every step makes new ones."""
    fields = [name for name, field in vars(type(part)).items() if getattr(field, "fset", None) is not None]
    values = {name: getattr(part, name) for name in fields}
    return {name: np.copy(value) for name, value in values.items() if isinstance(value, (np.ndarray, float, int))}


def _changed(part: Any, original: Any) -> Numbers:
    """Return the numbers of ``part`` that differ from those of ``original``, even in a bit."""
    before = _numbers(original)
    return {name: value for name, value in _numbers(part).items() if value.tobytes() != before[name].tobytes()}


def _write(part: Any, numbers: Numbers) -> None:
    """Write ``numbers`` into a struct."""
    for name, value in numbers.items():
        setattr(part, name, value if value.ndim else value.item())
