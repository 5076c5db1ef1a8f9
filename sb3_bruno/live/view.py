"""Where a scene is looked at from."""

from typing import NamedTuple


class View(NamedTuple):
    """The place of the camera and what it looks at, in m."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
