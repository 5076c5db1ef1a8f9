"""Shows a MuJoCo environment in 3-D: its shapes are made once, and each step moves its bodies.

The world moves under the robot, so a camera that stands still follows it over an endless floor.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium as gym
import mujoco
import numpy as np
import viser
from numpy.typing import NDArray

from sb3_bruno.live.geometry import is_floor, shapes_of
from sb3_bruno.live.view import View

_CELL = 0.5  # m, between the lines of the floor


class RobotScene:
    """Shows a MuJoCo model, and follows its first body.

    Args:
        server: the page's server, whose scene is empty.
        env: an environment whose innermost has a MuJoCo ``model`` and ``data``.
    """

    def __init__(self, server: viser.ViserServer, env: gym.Env[Any, Any]) -> None:
        inner: Any = env.unwrapped
        self._model, self._data = inner.model, inner.data
        self._followed = min(1, self._model.nbody - 1)  # 0 is the world
        self._server = server
        self._world = server.scene.add_frame("/world", show_axes=False)
        self._bodies = [server.scene.add_frame(f"/world/body_{i}", show_axes=False) for i in range(self._model.nbody)]
        self._shapes = []
        for shape in shapes_of(self._model):
            handle = server.scene.add_mesh_simple(
                f"/world/body_{shape.body}/{shape.name}",
                shape.mesh.vertices,
                shape.mesh.faces,
                color=(255 * shape.rgba[:3]).astype(np.uint8),
                opacity=None if shape.rgba[3] >= 1 else float(shape.rgba[3]),
                position=shape.position,
                wxyz=shape.wxyz,
            )
            self._shapes.append((handle, shape))
        self._add_floor()
        self._before = self._now = self._poses()
        self.draw(1.0)

    def _add_floor(self) -> None:
        """Lay an endless floor where the model has a level plane."""
        heights = [self._model.geom_pos[i][2] for i in range(self._model.ngeom) if is_floor(self._model, i)]
        for height in heights[:1]:
            self._server.scene.add_grid(
                "/world/floor",
                infinite_grid=True,
                cell_size=_CELL,
                section_size=2 * _CELL,
                position=(0.0, 0.0, float(height)),
                fade_distance=40.0,
                shadow_opacity=0.25,
                cell_color=(190, 194, 200),
                cell_thickness=0.6,
                section_color=(120, 126, 136),
                section_thickness=0.9,
            )

    @property
    def view(self) -> View:
        """Return where to look from: aside, at the robot's middle."""
        size = float(np.clip(self._model.stat.extent, 0.5, 4.0))
        height = float(self._data.xpos[self._followed][2])
        return View(position=(0.15 * size, -0.85 * size, height + 0.25 * size), look_at=(0.0, 0.0, 0.7 * height))

    def update(self, *, jumps: bool) -> None:
        """Note where the bodies are now; if they jumped, as at a reset, forget where they were."""
        poses = self._poses()
        self._before = poses if jumps else self._now
        self._now = poses

    def _poses(self) -> _Poses:
        return _Poses(self._data.xpos.copy(), self._data.xquat.copy())

    def draw(self, progress: float) -> None:
        """Show the bodies on their way from where they were to where they are, 0 to 1."""
        positions, orientations = self._before.towards(self._now, progress)
        followed = positions[self._followed]
        with self._server.atomic():
            self._world.position = (-followed[0], -followed[1], 0.0)
            for frame, position, wxyz in zip(self._bodies, positions, orientations, strict=True):
                frame.position, frame.wxyz = position, wxyz
            for handle, shape in self._shapes:  # an environment may move them, as the mark of a goal
                handle.position = shape.position


class _Poses(NamedTuple):
    """Where the bodies are, ``(n_bodies, 3)``, and how they are turned, as quaternions ``(n_bodies, 4)``."""

    positions: NDArray[np.float64]
    orientations: NDArray[np.float64]

    def towards(self, other: _Poses, progress: float) -> _Poses:
        """Go a part of the way to other poses, the shorter way round."""
        sign = np.where((self.orientations * other.orientations).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
        turned = (1 - progress) * self.orientations + progress * sign * other.orientations
        unit = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        return _Poses((1 - progress) * self.positions + progress * other.positions, unit)


def is_robot(env: gym.Env[Any, Any]) -> bool:
    """Say whether an environment simulates a MuJoCo model."""
    inner: Any = env.unwrapped
    return isinstance(getattr(inner, "model", None), mujoco.MjModel) and hasattr(inner, "data")
