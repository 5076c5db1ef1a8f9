"""Paints square images of points in the plane, without a graphics library; knows no environment."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Colour: TypeAlias = tuple[int, int, int]  # red, green, blue, 0 to 255

GREY: Colour = (190, 190, 190)
GREEN: Colour = (40, 160, 70)
BLUE: Colour = (30, 80, 200)

_PIXELS = 128  # height and width of an image


def blank_image() -> NDArray[np.uint8]:
    """Return a white image, ``(128, 128, 3)``."""
    return np.full((_PIXELS, _PIXELS, 3), 255, dtype=np.uint8)


def paint(
    image: NDArray[np.uint8], points: NDArray[np.float64], colour: Colour, *, pixels_per_unit: float, radius: int = 0
) -> None:
    """Paint a square of ``2 * radius + 1`` pixels at each point, ``(n, 2)``.

    The origin is in the middle of the image, x points right and y up. Points outside are painted on the border.
    """
    columns, rows = (_PIXELS / 2 + pixels_per_unit * points * (1.0, -1.0)).astype(int).T  # y points up
    for down in range(-radius, radius + 1):
        for right in range(-radius, radius + 1):
            image[np.clip(rows + down, 0, _PIXELS - 1), np.clip(columns + right, 0, _PIXELS - 1)] = colour


def arrow(tip: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points of an arrow from the origin to ``tip``, ``(60, 2)``."""
    back, side = -tip, np.array([-tip[1], tip[0]])
    shaft = np.linspace(0.0, 1.0, 40)[:, None] * tip
    barb = np.linspace(0.0, 0.25, 10)[:, None]
    return np.concatenate([shaft, tip + barb * (back + side), tip + barb * (back - side)])
