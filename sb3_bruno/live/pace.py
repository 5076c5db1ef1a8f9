"""Says when the next step is due, at a fixed rate. What is late is not caught up on."""

from __future__ import annotations

import time
from collections.abc import Callable


class Pace:
    """Spaces steps evenly. A step that comes late by more than one moves those after it, so that none are hurried.

    Args:
        clock: returns seconds; another one than the machine's is for tests.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._due = clock()
        self._period = 0.0

    def wait(self) -> float:
        """Return the seconds until the next step is due, 0 or more."""
        return max(self._due - self._clock(), 0.0)

    def progress(self) -> float:
        """Return how much of the time between two steps has passed since the last one was due, 0 to 1."""
        return 1.0 - min(self.wait() / self._period, 1.0) if self._period > 0 else 1.0

    def step(self, period: float) -> None:
        """Note that a step begins now, and that the next is due ``period`` seconds after this one was, or after now."""
        now = self._clock()
        is_late = now - self._due > period
        self._due = (now if is_late else self._due) + period
        self._period = period
