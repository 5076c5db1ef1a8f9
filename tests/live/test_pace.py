"""Steps are due at an even rate, and none that was missed is caught up on."""

import pytest

from sb3_bruno.live.pace import Pace


class Clock:
    """Stands still unless it is moved."""

    now = 0.0

    def __call__(self):
        return self.now


def test_steps_in_time_are_evenly_spaced():
    clock = Clock()
    pace, begun = Pace(clock), []
    for work in (0.01, 0.04, 0.0, 0.02):
        clock.now += pace.wait()
        begun.append(clock.now)
        pace.step(0.05)
        clock.now += work
    assert begun == pytest.approx([0.0, 0.05, 0.10, 0.15])


def test_what_is_late_is_not_caught_up_on():
    clock = Clock()
    pace, begun = Pace(clock), []
    for work in (1.0, 0.01, 0.01, 0.01):
        clock.now += pace.wait()
        begun.append(clock.now)
        pace.step(0.05)
        clock.now += work
    assert begun == pytest.approx([0.0, 1.0, 1.05, 1.10])


def test_the_rate_may_change_at_any_step():
    clock = Clock()
    pace = Pace(clock)
    pace.step(0.05)
    assert pace.wait() == pytest.approx(0.05)
    clock.now += pace.wait()
    pace.step(0.5)
    assert pace.wait() == pytest.approx(0.5)
