"""Spaces and settings come back from JSON as they were, and what JSON cannot hold is refused by name."""

import numpy as np
import pytest
from gymnasium import spaces
from torch import nn

from sb3_bruno.encoders import find_encoder
from sb3_bruno.export.plain import from_plain, to_plain
from sb3_bruno.export.space_json import read_space, write_space
from support.tiny_models import assert_same


@pytest.mark.parametrize(
    "space",
    [
        spaces.Box(-np.inf, np.inf, (3,)),
        spaces.Box(np.array([-1.0, 0.1], np.float32), np.array([np.inf, 0.3], np.float32)),
        spaces.Box(0, 255, (2, 3), np.uint8),
        spaces.Box(-1.0, 1.0, ()),
        spaces.Box(-1.0, 1.0, (0,), np.float64),
        spaces.Dict({"b": spaces.Box(0.0, 1.0, (1,)), "a": spaces.Box(-2.0, np.inf, (2,))}),
    ],
    ids=str,
)
def test_spaces_come_back(space):
    assert read_space(write_space(space, "space")) == space


def test_a_space_of_another_kind_is_refused_by_name():
    with pytest.raises(ValueError, match=r"`space\['a'\]` is Discrete"):
        write_space(spaces.Dict({"a": spaces.Discrete(3)}), "space")


@pytest.mark.parametrize(
    "value",
    [None, True, 3, 0.1, float("inf"), "text", [1, (2, [3.5])], {"a": {"b": (None,)}}, nn.ReLU, find_encoder("bruno")],
    ids=str,
)
def test_settings_come_back(value):
    assert from_plain(to_plain(value, "value")) == value


def test_numbers_of_numpy_come_back():
    found = from_plain(to_plain({"count": np.int64(3), "array": np.eye(2, dtype=np.float32)}, "value"))
    assert found["count"] == 3
    assert found["array"].dtype == np.float32
    assert_same(found["array"], np.eye(2, dtype=np.float32))


@pytest.mark.parametrize(
    ("value", "message"), [({1: 2}, "has the key 1"), ({"$a": 2}, "has the key"), ({"a": {2}}, r"`value\.a` is a set")]
)
def test_settings_that_json_cannot_hold_are_refused_by_name(value, message):
    with pytest.raises(ValueError, match=message):
        to_plain(value, "value")
