"""Makes meshes of what a MuJoCo model is built of."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

_SHOWN_GROUPS = 3  # MuJoCo's own viewer shows the groups 0, 1 and 2


class Shape(NamedTuple):
    """A mesh that a body carries.

    Attributes:
        name: of its own in a model.
        body: the place of its body in the model, 0 for the world.
        mesh: in the frame of the shape.
        position: of that frame in the body's, ``(3,)``, in m.
        wxyz: its orientation there, a quaternion.
        rgba: its colour, ``(4,)``, 0 to 1.
    """

    name: str
    body: int
    mesh: trimesh.Trimesh
    position: NDArray[np.float64]
    wxyz: NDArray[np.float64]
    rgba: NDArray[np.float32]


def shapes_of(model: Any) -> Iterator[Shape]:
    """Make the shapes of a MuJoCo model that its viewer would show, except floors."""
    for i in range(model.ngeom):
        rgba = model.geom_rgba[i] if model.geom_matid[i] < 0 else model.mat_rgba[model.geom_matid[i]]
        if model.geom_group[i] < _SHOWN_GROUPS and rgba[3] > 0 and not is_floor(model, i):
            mesh = _mesh(model, model.geom_type[i], model.geom_size[i], model.geom_dataid[i])
            yield Shape(f"geom_{i}", model.geom_bodyid[i], mesh, model.geom_pos[i], model.geom_quat[i], rgba)
    for i in range(model.nsite):
        rgba = model.site_rgba[i] if model.site_matid[i] < 0 else model.mat_rgba[model.site_matid[i]]
        if model.site_group[i] < _SHOWN_GROUPS and rgba[3] > 0:
            mesh = _mesh(model, model.site_type[i], model.site_size[i], -1)
            yield Shape(f"site_{i}", model.site_bodyid[i], mesh, model.site_pos[i], model.site_quat[i], rgba)


def is_floor(model: Any, geom: int) -> bool:
    """Say whether a geom is a level plane of the world."""
    upward = np.zeros(9)
    mujoco.mju_quat2Mat(upward, model.geom_quat[geom])
    is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
    return bool(is_plane and model.geom_bodyid[geom] == 0 and upward[8] > 0.999)


def _mesh(model: Any, kind: int, size: NDArray[np.float64], data: int) -> trimesh.Trimesh:
    """Make the mesh of a geom or site, by MuJoCo's conventions for sizes."""
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _own_mesh(model, data)
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return _height_field(model, data)
    mesh: trimesh.Trimesh = _primitive(kind, size)
    return mesh


def _primitive(kind: int, size: NDArray[np.float64]) -> Any:
    """Make a mesh of one of MuJoCo's primitives."""
    create, kinds = trimesh.creation, mujoco.mjtGeom
    if kind == kinds.mjGEOM_PLANE:  # 0 is endless
        return create.box([2 * (size[0] or 50.0), 2 * (size[1] or 50.0), 0.01])
    if kind == kinds.mjGEOM_CAPSULE:
        return create.capsule(height=2 * size[1], radius=size[0], count=[16, 24])
    if kind == kinds.mjGEOM_CYLINDER:
        return create.cylinder(radius=size[0], height=2 * size[1], sections=32)
    if kind == kinds.mjGEOM_BOX:
        return create.box(2 * size)
    ball = create.icosphere(subdivisions=3, radius=1.0)
    return ball.apply_scale(size if kind == kinds.mjGEOM_ELLIPSOID else size[0])


def _own_mesh(model: Any, data: int) -> trimesh.Trimesh:
    """Cut a mesh out of the model's lists of vertices and faces."""
    first, n = model.mesh_vertadr[data], model.mesh_vertnum[data]
    first_face, n_faces = model.mesh_faceadr[data], model.mesh_facenum[data]
    vertices, faces = model.mesh_vert[first : first + n], model.mesh_face[first_face : first_face + n_faces]
    return trimesh.Trimesh(vertices, faces, process=False)


def _height_field(model: Any, data: int) -> trimesh.Trimesh:
    """Make the surface of a height field: a grid of rows along y and columns along x."""
    rows, columns, first = model.hfield_nrow[data], model.hfield_ncol[data], model.hfield_adr[data]
    radius_x, radius_y, top, _ = model.hfield_size[data]
    y, x = np.meshgrid(np.linspace(-radius_y, radius_y, rows), np.linspace(-radius_x, radius_x, columns), indexing="ij")
    z = top * model.hfield_data[first : first + rows * columns]
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()  # the lowest of each cell
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + columns + 1], axis=1),
            np.stack([corner, corner + columns + 1, corner + columns], axis=1),
        ]
    )
    return trimesh.Trimesh(np.stack([x.ravel(), y.ravel(), z], axis=1), faces, process=False)
