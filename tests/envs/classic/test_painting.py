"""Tests of the painting: where points land, how large they are, what becomes of those outside."""

import numpy as np
import pytest

from sb3_bruno_envs.classic.painting import BLUE, blank_image, paint


def painted(point, **kwargs):
    """Rows and columns of the blue pixels of one point on a white image."""
    image = blank_image()
    paint(image, np.array([point]), BLUE, **kwargs)
    blue = (image == BLUE).all(axis=2)
    assert (image[~blue] == 255).all()
    return np.argwhere(blue).tolist()


@pytest.mark.parametrize(
    ("point", "row", "column"), [((0.0, 0.0), 64, 64), ((1.0, 2.0), 44, 74), ((-99.0, 99.0), 0, 0)]
)
def test_a_point_is_painted_right_and_up_of_the_middle_or_on_the_border(point, row, column):
    assert painted(point, pixels_per_unit=10.0) == [[row, column]]


def test_a_radius_makes_a_square():
    square = [[row, column] for row in (63, 64, 65) for column in (63, 64, 65)]
    assert painted((0.0, 0.0), pixels_per_unit=10.0, radius=1) == square
