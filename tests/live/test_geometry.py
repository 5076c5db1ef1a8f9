"""The meshes are of the sizes that MuJoCo gives its shapes, and only what its viewer shows is made."""

import mujoco
import numpy as np
import pytest

from sb3_bruno.live.geometry import is_floor, shapes_of

WORLD = """
<mujoco>
  <asset>
    <material name="red" rgba="1 0 0 1"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 2 0  0 0 3"/>
    <hfield name="hill" nrow="3" ncol="4" size="2 1 0.5 0.1" elevation="0 0 0 0  0 1 1 0  0 0 0 0"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" pos="0 0 0.1"/>
    <geom name="wall" type="plane" size="2 1 1" euler="90 0 0"/>
    <geom type="hfield" hfield="hill"/>
    <body>
      <geom type="sphere" size="0.5" material="red"/>
      <geom type="capsule" size="0.1 0.4"/>
      <geom type="cylinder" size="0.1 0.4"/>
      <geom type="box" size="1 2 3"/>
      <geom type="ellipsoid" size="1 2 3" pos="0 0 4"/>
      <geom type="mesh" mesh="wedge"/>
      <geom type="sphere" size="9" group="3"/>
      <geom type="sphere" size="9" rgba="1 1 1 0"/>
      <site name="goal" type="sphere" size="0.2" rgba="0 1 0 0.5"/>
      <joint type="slide"/>
    </body>
  </worldbody>
</mujoco>
"""
EXTENTS = [(4, 2, 0.01), (4, 2, 0.5), (1, 1, 1), (0.2, 0.2, 1), (0.2, 0.2, 0.8), (2, 4, 6), (2, 4, 6)]


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(WORLD)


def test_shapes_have_mujocos_sizes(model):
    shapes = list(shapes_of(model))
    assert len(shapes) == 9 and len({shape.name for shape in shapes}) == 9
    for shape, extents in zip(shapes, EXTENTS, strict=False):
        np.testing.assert_allclose(shape.mesh.extents, extents, rtol=0.02)
        np.testing.assert_allclose(shape.mesh.bounds.mean(axis=0)[:2], 0.0, atol=1e-3)
    assert [shape.body for shape in shapes] == [0, 0, *7 * [1]]
    assert shapes[2].rgba.tolist() == [1, 0, 0, 1] and shapes[-1].rgba.tolist() == [0, 1, 0, 0.5]


def test_a_mesh_of_its_own_is_where_the_file_has_it(model):
    """MuJoCo moves and turns a mesh to its axes of inertia; the shape's frame turns it back."""
    wedge = next(shape for shape in shapes_of(model) if len(shape.mesh.vertices) == 4)
    turned = np.array([_rotated(vertex, wedge.wxyz) for vertex in wedge.mesh.vertices]) + wedge.position
    np.testing.assert_allclose(
        sorted(turned.round(5).tolist()), [[0, 0, 0], [0, 0, 3], [0, 2, 0], [1, 0, 0]], atol=1e-4
    )


def test_the_top_of_a_hill_is_in_its_middle(model):
    hill = list(shapes_of(model))[1].mesh
    top = hill.vertices[hill.vertices[:, 2] > 0.4]
    np.testing.assert_allclose(sorted(top[:, 0]), [-2 / 3, 2 / 3], atol=1e-6)
    np.testing.assert_allclose(top[:, 1], 0.0, atol=1e-6)
    assert (hill.face_normals[:, 2] > 0).all()  # seen from above


def test_only_a_level_plane_of_the_world_is_a_floor(model):
    assert [is_floor(model, i) for i in range(model.ngeom)] == [True, *(model.ngeom - 1) * [False]]


def _rotated(vector, wxyz):
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, np.asarray(vector, dtype=np.float64), wxyz)
    return turned
