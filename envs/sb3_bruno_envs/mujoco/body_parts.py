"""Says what the log factors of a hidden body belong to, and names a body by them; knows no particular robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

_MOST_TOLD = 2  # factors in a name


class BodyParts(NamedTuple):
    """The parts of a planar robot that a task scales, in the order of its numbers (see HiddenBody).

    Attributes:
        bodies: those with a mass.
        joints: those with damping.
        feet: the bodies whose friction counts.
    """

    bodies: Sequence[str]
    joints: Sequence[str]
    feet: Sequence[str]

    def entries(self) -> tuple[tuple[str, str], ...]:
        """Say what the numbers of a task are: name and unit of each."""
        return tuple((f"log {kind} of {part}", "") for kind, parts in self._kinds() for part in parts)

    def name(self, task: ArrayLike) -> str:
        """Name a body by the two factors that are farthest from 1: ``"foot mass x0.4, thigh damping x1.9"``.

        A factor of all masses, dampings or frictions counts as one: ``"every mass x1.2"``. A published task is named by
        those of its numbers that change a robot in a plane the most.

        Raises:
            ValueError: if ``task`` has neither form.
        """
        logs = self._in_plane(np.asarray(task, dtype=np.float64))
        factors: dict[str, float] = {}  # their logarithms
        for (kind, parts), of_kind in zip(self._kinds(), np.split(logs, self._borders()), strict=True):
            if len(parts) > 1 and np.ptp(of_kind) == 0.0:
                factors[f"every {kind}"] = of_kind[0]
            else:
                factors.update({f"{part} {kind}": log for part, log in zip(parts, of_kind, strict=True)})
        changed = sorted((label for label in factors if factors[label]), key=lambda label: -abs(factors[label]))
        digits = 5 if len(changed) == 1 else 3  # one factor alone has to tell bodies apart
        told = [f"{label} x{np.exp(factors[label]):.{digits}g}" for label in changed[:_MOST_TOLD]]
        return ", ".join(told) or "original body"

    def _kinds(self) -> list[tuple[str, Sequence[str]]]:
        return [("mass", self.bodies), ("damping", self.joints), ("friction", self.feet)]

    def _borders(self) -> list[int]:
        """Return where dampings and frictions begin in a task."""
        return [len(self.bodies), len(self.bodies) + len(self.joints)]

    def _in_plane(self, task: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the log factors of masses, dampings and frictions, of a task as published too."""
        bodies, joints = 1 + len(self.bodies), 3 + len(self.joints)  # the world; how the robot moves in the plane
        own, published = sum(map(len, self)), 4 * bodies + joints + 3 * bodies
        if task.shape == (own,):
            return task
        if task.shape != (published,):
            raise ValueError(f"task={task!r} is invalid: give {own} log factors, or {published} as published.")
        masses, _, dampings, frictions = np.split(task, np.cumsum([bodies, 3 * bodies, joints]))
        sliding = frictions[3::3]  # each body has one geom, and the world the floor's
        return np.concatenate([masses[1:], dampings[3:], [sliding[self.bodies.index(foot)] for foot in self.feet]])
