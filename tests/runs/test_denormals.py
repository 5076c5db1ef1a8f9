"""Denormal numbers are zero inside, if the CPU can do that, and are back outside even after an error."""

import pytest
import torch as th

from sb3_bruno.runs.denormals import flushed_denormals

SMALL = 1e-310  # denormal in float64


def half() -> float:
    return (th.tensor([SMALL], dtype=th.float64) * 0.5).item()


def train(can_flush: bool) -> None:
    with flushed_denormals():
        assert (half() == 0) == can_flush
        raise RuntimeError("in the middle of a training")


def test_denormals_are_zero_inside_and_back_outside() -> None:
    can_flush = th.set_flush_denormal(False)
    assert half() > 0
    with pytest.raises(RuntimeError, match="in the middle"):
        train(can_flush)
    assert half() > 0
