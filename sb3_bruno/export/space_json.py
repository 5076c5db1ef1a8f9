"""Writes Gymnasium's spaces as JSON, bounds and all, and reads them."""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sb3_bruno.export.limits import LARGEST_DICT, LARGEST_SPACE
from sb3_bruno.export.plain import read_dtype, read_number, read_shape, to_plain
from sb3_bruno.files.shown import shown


def write_space(space: spaces.Space[Any], place: str) -> dict[str, Any]:
    """Write a Box, or a Dict of them.

    Args:
        space: the space.
        place: its name, for the error.

    Raises:
        ValueError: if it is another one.
    """
    if type(space) is spaces.Dict:
        entries = {key: write_space(entry, f"{place}[{key!r}]") for key, entry in space.spaces.items()}
        return {"kind": "Dict", "spaces": entries}
    if type(space) is not spaces.Box:
        raise ValueError(f"`{place}` is {space}, which an agent file cannot hold: make it a Box, or a Dict of them")
    written = {
        "kind": "Box",
        "low": _write_bound(space.low, place),
        "high": _write_bound(space.high, place),
        "shape": list(space.shape),
        "dtype": space.dtype.name,
    }
    if read_space(written) != space:
        raise ValueError(f"`{place}` is {space}, which cannot be told in numbers: give other bounds")
    return written


def read_space(plain: Any) -> spaces.Space[Any]:
    """Read a space.

    Raises:
        ValueError: if it is none, or too large.
    """
    kind = plain.get("kind") if isinstance(plain, dict) else None
    if kind == "Dict" and set(plain) == {"kind", "spaces"} and isinstance(plain["spaces"], dict):
        if len(plain["spaces"]) > LARGEST_DICT:
            raise ValueError(f"a Dict has {len(plain['spaces']):,} spaces, and {LARGEST_DICT} are allowed")
        boxes: OrderedDict[str, spaces.Space[Any]] = OrderedDict()
        n_numbers = 0
        for key, entry in plain["spaces"].items():
            box = boxes[key] = read_box(entry)
            n_numbers += math.prod(box.shape)
            if n_numbers > LARGEST_SPACE:
                raise ValueError(f"a Dict has more than {LARGEST_SPACE:,} numbers")
        return spaces.Dict(boxes)
    return read_box(plain)


def read_box(plain: Any) -> spaces.Box:
    """Read a Box.

    Raises:
        ValueError: if it is none, or too large.
    """
    names = {"kind", "low", "high", "shape", "dtype"}
    if not isinstance(plain, dict) or set(plain) != names or plain["kind"] != "Box":
        raise ValueError(f"{shown(plain)} is no space that agent files know")
    shape, dtype = read_shape(plain["shape"]), read_dtype(plain["dtype"])
    low, high = (_read_bound(plain[name], shape, dtype) for name in ("low", "high"))
    if not (low <= high).all():
        raise ValueError("a Box has a lower bound above its upper one")
    return spaces.Box(low, high, shape, dtype.type)


def _write_bound(bound: NDArray[Any], place: str) -> Any:
    """Write a bound as one number, where it is the same everywhere, or as a list."""
    numbers = [to_plain(number, place) for number in bound.ravel()]
    return numbers[0] if numbers and all(number == numbers[0] for number in numbers) else numbers


def _read_bound(plain: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    if isinstance(plain, list):
        return np.array([read_number(number) for number in plain], dtype).reshape(shape)
    return np.full(shape, read_number(plain), dtype)
