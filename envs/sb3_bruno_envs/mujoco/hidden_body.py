"""Gives a planar robot a body that a task names by log factors; knows no particular robot."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.mujoco.body_parts import BodyParts
from sb3_bruno_envs.mujoco.exact_state import ExactState
from sb3_bruno_envs.mujoco.physics import scale_physics
from sb3_bruno_envs.read_task import read_numbers


class HiddenBody(ExactState):
    """Multiplies the numbers of the model by the exponentials of a task; the reward stays Gymnasium's.

    Put it before Gymnasium's class. A task holds, in this order, natural logarithms of factors:

    - of each body's mass, and of its rotational inertia with it, as a denser material;
    - of each damped joint's damping;
    - of each foot's sliding friction. Of two geoms in contact MuJoCo takes the greater, so the floor's is the least.

    With ``published=True`` a task holds a log factor for every entry, as in the environments of PEARL (Rakelly et al.,
    2019): mass ``(n_bodies,)``, inertia ``(n_bodies, 3)``, damping ``(n_velocities,)`` and friction ``(n_geoms, 3)``,
    those of world and floor too. Two thirds of these numbers change nothing in a plane. The others make bodies that
    cannot exist: their inertias violate the triangle inequality in nine of ten tasks. What MuJoCo derives from masses
    stays that of the original body.

    Args:
        frame_skip: steps of the simulation (0.002 s) per step of the environment. 8 makes 0.016 s, as published; 4 are
            Gymnasium's 0.008 s.
        published: take tasks as published.
        **kwargs: further keyword arguments of Gymnasium's class.
    """

    feet: ClassVar[tuple[str, ...]]
    """The names of the geoms that touch the floor."""
    parts: ClassVar[BodyParts]
    """What people call bodies, joints and feet, in the model's order."""

    def __init__(self, *, frame_skip: int = 8, published: bool = False, **kwargs: Any) -> None:
        self.published = published
        super().__init__(frame_skip=frame_skip, **kwargs)

    def read_task(self, task: ArrayLike) -> list[NDArray[np.float64]]:
        """Return the factors of a task ``(dim,)``, those of each kind in an array of their own.

        Raises:
            ValueError: if a number is not finite, or their number is wrong.
        """
        model = self.original_model
        counts = [len(self._bodies()), len(self._joints()), len(self.feet)]
        if self.published:
            counts = [model.nbody, 3 * model.nbody, model.nv, 3 * model.ngeom]
        logs = read_numbers(task, sum(counts), "log factors, 0 for the original")
        return np.split(np.exp(logs), np.cumsum(counts)[:-1])

    def set_task(self, task: ArrayLike) -> None:
        """Write the model's numbers from a task (see ``read_task``); the state of the episode stays."""
        write = self._write_every_entry if self.published else self._write_body
        write(*self.read_task(task))

    @classmethod
    def name_task(cls, task: ArrayLike) -> str:
        """Return the factors that are farthest from 1."""
        return cls.parts.name(task)

    def _bodies(self) -> list[str]:
        model = self.original_model
        return [model.body(i).name for i in range(1, model.nbody)]  # 0 is the world

    def _joints(self) -> list[str]:
        model = self.original_model
        return [model.joint(i).name for i in range(model.njnt) if model.joint(i).damping[0] > 0.0]

    def _write_body(
        self, masses: NDArray[np.float64], dampings: NDArray[np.float64], frictions: NDArray[np.float64]
    ) -> None:
        scale_physics(
            self,
            mass=dict(zip(self._bodies(), masses, strict=True)),
            damping=dict(zip(self._joints(), dampings, strict=True)),
            friction=dict(zip(self.feet, frictions, strict=True)),
        )

    def _write_every_entry(
        self,
        masses: NDArray[np.float64],
        inertias: NDArray[np.float64],
        dampings: NDArray[np.float64],
        frictions: NDArray[np.float64],
    ) -> None:
        model, original = self.model, self.original_model
        model.body_mass[:] = masses * original.body_mass
        model.body_inertia[:] = inertias.reshape(-1, 3) * original.body_inertia
        model.dof_damping[:] = dampings * original.dof_damping
        model.geom_friction[:] = frictions.reshape(-1, 3) * original.geom_friction
