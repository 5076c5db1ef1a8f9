"""Shows an environment that paints itself, as a picture that stands in the scene."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import viser
from numpy.typing import NDArray

from sb3_bruno.live.view import View

_HEIGHT = 2.0  # of the picture in the scene, in m
_BORDER, _GREY = ((3, 3), (3, 3), (0, 0)), 190  # of the picture, for many are white, as the page is
_FEWEST_PIXELS = 512  # of its height; a browser blurs what is smaller


class PictureScene:
    """Shows what ``render`` returns.

    Args:
        server: the page's server, whose scene is empty.
        env: an environment with ``render_mode="rgb_array"``, which has been reset.

    Raises:
        ValueError: if it paints no picture.
    """

    view = View(position=(0.0, -2.4, 0.0), look_at=(0.0, 0.0, 0.0))

    def __init__(self, server: viser.ViserServer, env: gym.Env[Any, Any]) -> None:
        self._env, self._is_old = env, False
        image = self._image()
        height, width = image.shape[:2]
        self._picture = server.scene.add_image(
            "/picture",
            image,
            render_width=_HEIGHT * width / height,
            render_height=_HEIGHT,
            wxyz=(2**-0.5, -(2**-0.5), 0.0, 0.0),  # upright, its face to the camera
            format="png",
            cast_shadow=False,
            receive_shadow=False,
        )

    def update(self, *, jumps: bool) -> None:
        """Note that the environment has taken a step."""
        self._is_old = True

    def draw(self, progress: float) -> None:
        """Show the picture as it is now.

        Raises:
            ValueError: if the environment has painted none.
        """
        if self._is_old:
            self._picture.image = self._image()
            self._is_old = False

    def _image(self) -> NDArray[np.uint8]:
        """Paint the environment, each pixel a block if there are few."""
        image = np.asarray(self._env.render())
        if image.ndim != 3 or image.shape[-1] not in (3, 4) or image.size == 0 or image.dtype.kind not in "iu":
            remedy = "have `render` return its pixels, (height, width, 3) in uint8"
            raise ValueError(f"{self._env} painted {_described(image)}: {remedy}.")
        image = image[..., :3].astype(np.uint8)
        factor = -(-_FEWEST_PIXELS // len(image))
        return np.pad(image.repeat(factor, axis=0).repeat(factor, axis=1), _BORDER, constant_values=_GREY)


def _described(image: NDArray[Any]) -> str:
    """Say what is no picture."""
    return "nothing" if image.dtype == object else f"an array of shape {image.shape} in {image.dtype}"
