"""Turns settings into what JSON can hold, and back: numbers, text, lists, dicts, and what has a key.

JSON has no tuples, classes or infinities. Each is a dict with one key that begins with a dollar sign:
``{"$tuple": [16, 16]}``, ``{"$module": "ReLU"}``, ``{"$float": "inf"}``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.utils import ConstantSchedule, FloatSchedule, LinearSchedule

from sb3_bruno.export.classes import find, key_of, kind_of
from sb3_bruno.export.limits import LARGEST_SPACE, LARGEST_WHOLE
from sb3_bruno.files.shown import shown


class _Parts(NamedTuple):
    """What an object is rebuilt from.

    Attributes:
        kind: its class.
        attributes: the arguments of its constructor by name, and the attribute that keeps each.
    """

    kind: Callable[..., Any]
    attributes: dict[str, str]


_OBJECTS = {
    "ConstantSchedule": _Parts(ConstantSchedule, {"val": "val"}),
    "FloatSchedule": _Parts(FloatSchedule, {"value_schedule": "value_schedule"}),
    "LinearSchedule": _Parts(LinearSchedule, {"start": "start", "end": "end", "end_fraction": "end_fraction"}),
    "NormalActionNoise": _Parts(NormalActionNoise, {"mean": "_mu", "sigma": "_sigma"}),
    "OrnsteinUhlenbeckActionNoise": _Parts(
        OrnsteinUhlenbeckActionNoise,
        {"mean": "_mu", "sigma": "_sigma", "theta": "_theta", "dt": "_dt", "initial_noise": "initial_noise"},
    ),
}
_KINDS = {parts.kind for parts in _OBJECTS.values()}
_DTYPES = ("float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "bool")


def to_plain(value: Any, place: str) -> Any:
    """Turn a setting into what JSON can hold.

    Args:
        value: the setting.
        place: its name, for the error.

    Raises:
        ValueError: if it cannot be turned, with what to give instead.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else {"$float": str(float(value))}
    if isinstance(value, np.ndarray):
        return {"$array": [to_plain(number, place) for number in value.ravel()], **_form(value, place)}
    if type(value) in (list, tuple):
        entries = [to_plain(entry, f"{place}[{number}]") for number, entry in enumerate(value)]
        return entries if isinstance(value, list) else {"$tuple": entries}
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str) or key.startswith("$"):
                raise ValueError(f"`{place}` has the key {key!r}: give names that are text and begin with no $")
        return {key: to_plain(entry, f"{place}.{key}") for key, entry in value.items()}
    for name, (kind, attributes) in _OBJECTS.items():
        if type(value) is kind:
            parts = {key: to_plain(vars(value)[attribute], place) for key, attribute in attributes.items()}
            return {"$object": name, **parts}
    if callable(value):
        return {f"${kind_of(value)}": key_of(value, place)}
    raise ValueError(f"`{place}` is a {type(value).__name__}, which is no plain data: give numbers, text, lists, dicts")


def from_plain(plain: Any) -> Any:
    """Turn what JSON held into a setting.

    Raises:
        ValueError: if something is named that nobody knows.
    """
    if isinstance(plain, list):
        return [from_plain(entry) for entry in plain]
    if not isinstance(plain, dict):
        return plain
    tag = next((key for key in plain if key.startswith("$")), None)
    if tag is None:
        return {key: from_plain(entry) for key, entry in plain.items()}
    content, rest = plain[tag], {key: entry for key, entry in plain.items() if key != tag}
    if tag == "$array":
        return _array(content, rest)
    if tag == "$object":
        return _object(content, rest)
    if rest:
        raise ValueError(f"{shown(tag)} stands beside {shown(list(rest))}")
    if tag == "$tuple" and isinstance(content, list):
        return tuple(from_plain(entry) for entry in content)
    if tag == "$float" and content in ("inf", "-inf"):
        return float(content)
    return _class(tag, content)


def read_json(data: bytes) -> dict[str, Any]:
    """Read a JSON object in which no key comes twice and every number is finite, whole ones of 64 bits.

    Raises:
        ValueError: if it is none; RecursionError if it is nested too deep.
    """
    found = json.loads(
        data.decode("utf-8"),
        object_pairs_hook=_once,
        parse_constant=_refuse_constant,
        parse_float=_finite,
        parse_int=_whole,
    )
    if not isinstance(found, dict):
        raise ValueError("its JSON holds no object")
    return found


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("its JSON has a key twice")
    return found


def _refuse_constant(text: str) -> float:
    raise ValueError(f"its JSON holds {text}, which is no number of JSON")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"its JSON holds {shown(text)}, which is too large a number")
    return number


def _whole(text: str) -> int:
    number = int(text)
    if abs(number) > LARGEST_WHOLE:
        raise ValueError(f"its JSON holds {shown(text)}, which is too large a whole number")
    return number


def _form(array: np.ndarray[Any, Any], place: str) -> dict[str, Any]:
    if array.dtype.name not in _DTYPES or array.size > LARGEST_SPACE:
        raise ValueError(f"`{place}` is an array of {array.size:,} {array.dtype}: give up to {LARGEST_SPACE:,} numbers")
    return {"dtype": array.dtype.name, "shape": list(array.shape)}


def _array(numbers: Any, form: dict[str, Any]) -> np.ndarray[Any, Any]:
    if set(form) != {"dtype", "shape"} or not isinstance(numbers, list):
        raise ValueError("an array lacks its dtype or shape")
    return np.array([read_number(number) for number in numbers], read_dtype(form["dtype"])).reshape(
        read_shape(form["shape"])
    )


def _object(name: Any, parts: dict[str, Any]) -> Any:
    if not isinstance(name, str) or name not in _OBJECTS or set(parts) != set(_OBJECTS[name].attributes):
        raise ValueError(f"it names {shown(name)}, which is no object that agent files know, or not all of its parts")
    read = {key: from_plain(part) for key, part in parts.items()}
    for key, part in read.items():
        is_number = isinstance(part, int | float | np.ndarray) and not isinstance(part, bool)
        is_left_out = part is None and key == "initial_noise"
        if not (is_number or is_left_out or type(part) in _KINDS):
            raise ValueError(f"the {key} of its {name} is {shown(part)}, and no number")
    return _OBJECTS[name].kind(**read)


def _class(tag: str, key: Any) -> Any:
    kind = tag.removeprefix("$")
    if kind not in ("buffer", "encoder", "flow", "function", "module", "optimizer", "policy"):
        raise ValueError(f"it names a {shown(tag)}, which agent files do not know")
    return find(kind, key)


def read_number(plain: Any) -> float:
    """Read a number, which may be infinite.

    Raises:
        ValueError: if it is none.
    """
    value = from_plain(plain)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{shown(plain)} is no number")
    return value


def read_dtype(plain: Any) -> np.dtype[Any]:
    """Read the type of an array's numbers.

    Raises:
        ValueError: if it is none that agent files know.
    """
    if plain not in _DTYPES:
        raise ValueError(f"{shown(plain)} is no type of numbers that agent files know")
    return np.dtype(str(plain))


def read_shape(plain: Any) -> tuple[int, ...]:
    """Read the shape of an array.

    Raises:
        ValueError: if it is none, or too large.
    """
    is_shape = isinstance(plain, list) and len(plain) <= 8 and all(type(size) is int and size >= 0 for size in plain)
    if not is_shape or math.prod(plain) > LARGEST_SPACE or any(size > LARGEST_SPACE for size in plain):
        raise ValueError(f"{shown(plain)} is no shape of up to {LARGEST_SPACE:,} numbers")
    return tuple(plain)
