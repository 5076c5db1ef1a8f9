"""What an environment's info tells of an episode: the name of its task, and its success. Knows NumPy alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sb3_bruno.task_names import one_line


def task_name(info: Mapping[str, Any]) -> str:
    """Return ``info["task_name"]`` on one line; ``""`` for nothing or None."""
    told = info.get("task_name")
    return "" if told is None else one_line(str(told))


def success(info: Mapping[str, Any]) -> float:
    """Return ``info["is_success"]`` as a number in [0, 1], such as 1 for True; NaN for nothing, None or NaN.

    Raises:
        ValueError: if it is something else.
    """
    told = info.get("is_success")
    if told is None:
        return np.nan
    try:
        number = np.asarray(told, dtype=np.float64).item()
    except (TypeError, ValueError):
        number = np.inf
    if number < 0.0 or number > 1.0:
        raise ValueError(f"info['is_success']={told!r:.60} is no success: let it be True, False, or a share in [0, 1].")
    return float(number)
