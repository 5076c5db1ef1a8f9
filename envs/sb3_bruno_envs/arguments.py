"""Refuses arguments of a wrong kind, by name and value and with what to give instead; knows no environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np


def check_env(env: object) -> None:
    """Raise a ValueError unless ``env`` is an environment."""
    if not isinstance(env, gym.Env):
        raise ValueError(f"env={env!r} is no environment: give one of Gymnasium's, such as gym.make returns.")


def check_count(name: str, value: Any) -> None:
    """Raise a ValueError unless the argument ``name`` counts something: 1, 2, 3, ..., and not True."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < 1:
        raise ValueError(f"{name}={value!r} is not a positive integer: give at least 1.")


def check_function(name: str, value: Any, call: str) -> None:
    """Raise a ValueError unless the argument ``name`` is None or can be called, as ``call`` says."""
    if value is not None and not callable(value):
        raise ValueError(f"{name}={value!r} is no function: pass {call}.")
