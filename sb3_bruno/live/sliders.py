"""Sliders, whose numbers visitors may drag, or type."""

from __future__ import annotations

import math

import viser

Slider = viser.GuiSliderHandle[float]


def value_of(slider: Slider) -> float:
    """Return what a slider says, within its bounds: any number may be typed, and "0.5" is 0 at first."""
    return min(max(float(slider.value), slider.min), slider.max)


def move(slider: Slider, value: float) -> None:
    """Move a slider as near to a value as it can come, unless it is there."""
    fitting = min(max(rounded(value, slider.step), slider.min), slider.max)
    if slider.value != fitting:
        slider.value = fitting  # type: ignore[misc]  # mypy misses viser's setter


def round_step(width: float) -> float:
    """Return a round step that divides a range into a hundred parts or more: 0.01 of a range of 3."""
    return 10.0 ** math.floor(math.log10(width / 100.0))


def rounded(value: float, step: float) -> float:
    """Return a number with as many digits as a step: 0.667 as 0.67 with a step of 0.01."""
    return round(float(value), max(-math.floor(math.log10(step)), 0))
