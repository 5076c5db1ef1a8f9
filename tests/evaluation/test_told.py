"""What an info tells is read alike by tests, callbacks and videos, in whatever form environments tell it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sb3_bruno.evaluation.told import success, task_name


@pytest.mark.parametrize(
    ("told", "number"),
    [
        (True, 1.0),
        (np.bool_(False), 0.0),
        (np.float32(1.0), 1.0),
        (0.5, 0.5),
        (np.array([True]), 1.0),
        (None, np.nan),
        (np.nan, np.nan),
    ],
)
def test_a_success_is_a_number_or_unknown(told: Any, number: float) -> None:
    np.testing.assert_equal(success({"is_success": told}), number)


def test_an_info_without_success_or_name_tells_nothing() -> None:
    assert np.isnan(success({})) and task_name({}) == task_name({"task_name": None}) == ""


@pytest.mark.parametrize("told", ["yes", 2.0, -1, [True, False], {}])
def test_what_is_no_success_is_refused(told: Any) -> None:
    with pytest.raises(ValueError, match=r"is_success.*let it be True"):
        success({"is_success": told})


def test_a_name_has_one_line() -> None:
    assert task_name({"task_name": " left,\n\tthen\0 right "}) == "left, then right"
