"""Draws a floor that has no end: it follows the robot while an image is made, and the physics never see it move."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray


@contextmanager
def endless_floor(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[None]:
    """Draw floor and lamps where the robot is; at the end of the block they are back to the bit.

    MuJoCo's planes have no end for collisions, but are drawn with one. A level plane moves by whole repeats of its
    texture, so that the pattern stays where it is.

    Args:
        model: of the simulation.
        data: of the simulation; only where its images show floor and lamps changes.
    """
    robot = data.subtree_com[0, :2].copy()  # m; the world itself has no mass
    floors, lamps = _floors(model, data), np.flatnonzero(model.light_bodyid == 0)
    floor_places, lamp_places = data.geom_xpos[floors].copy(), data.light_xpos[lamps].copy()
    repeat = _repeats(model, floors)
    data.geom_xpos[floors, :2] += repeat * np.round(robot / repeat)  # 4.1 m and repeats of 1.5 m: 4.5 m
    data.light_xpos[lamps, :2] += robot
    try:
        yield
    finally:
        data.geom_xpos[floors], data.light_xpos[lamps] = floor_places, lamp_places


def _floors(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.int64]:
    """Find the level planes of the world that are drawn with an end."""
    is_plane = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0)
    is_level = (data.geom_xmat == np.eye(3).ravel()).all(axis=1)
    return np.flatnonzero(is_plane & is_level & (model.geom_size[:, :2] > 0).all(axis=1))


def _repeats(model: mujoco.MjModel, floors: NDArray[np.int64]) -> NDArray[np.float64]:
    """Compute after how many metres the pattern of each floor repeats, ``(n_floors, 2)``: 1 where it has none."""
    repeats = np.ones((len(floors), 2))
    for row, floor in enumerate(floors):
        material = model.geom_matid[floor]
        if material >= 0:
            width = np.ones(2) if model.mat_texuniform[material] else model.geom_size[floor, :2]  # half of it
            repeats[row] = 2 * width / model.mat_texrepeat[material]
    return repeats
