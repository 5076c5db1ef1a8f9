"""Writes the statistics with which VecNormalize shows observations to an agent, and puts them around an env."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch import Tensor

from sb3_bruno.export.plain import read_number, to_plain
from sb3_bruno.files.shown import shown

_LARGEST = 1e30  # of a number whose square is finite in float64, and which is itself in float32
_RANGES = {
    "clip_obs": (1 / _LARGEST, math.inf),
    "clip_reward": (1 / _LARGEST, math.inf),
    "gamma": (0.0, 1.0),
    "epsilon": (1 / _LARGEST, _LARGEST),
}
"""The least and the greatest value of each number."""
_SETTINGS = ("norm_obs", "norm_reward", "norm_obs_keys", *_RANGES)


def write_normalization(env: VecNormalize) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Write the settings of a VecNormalize, and its statistics by name.

    Raises:
        ValueError: if it is a subclass, which may do something else; a setting is out of range; or a statistic is not
            finite.
    """
    if type(env) is not VecNormalize:
        raise ValueError(f"the env is normalised by {type(env).__name__}: use VecNormalize itself")
    check_normalization(env)
    settings = {name: to_plain(vars(env)[name], name) for name in _SETTINGS}
    statistics = _statistics(env)
    settings["counts"] = {name: to_plain(found.count, name) for name, found in statistics.items()}
    tensors: dict[str, Tensor] = {}
    for name, found in statistics.items():
        tensors[f"{name}.mean"] = th.from_numpy(np.array(found.mean, np.float64))
        tensors[f"{name}.var"] = th.from_numpy(np.array(found.var, np.float64))
    return settings, tensors


def normalized(env: VecEnv, plain: Any, tensors: Mapping[str, Tensor]) -> VecNormalize:
    """Put VecNormalize around an env as it was written. It learns no more until its ``training`` is set.

    Args:
        env: the env.
        plain: the settings.
        tensors: the statistics by name, from which those that are read are all.

    Raises:
        ValueError: if something is missing, or cannot be.
    """
    if not isinstance(plain, dict) or set(plain) != {*_SETTINGS, "counts"} or not isinstance(plain["counts"], dict):
        raise ValueError("the settings of its normalisation are not all there")
    keys = plain["norm_obs_keys"]
    if keys is not None and not (isinstance(keys, list) and all(isinstance(key, str) for key in keys)):
        raise ValueError(f"its normalisation has the keys {shown(keys)}")
    known: Any = env.observation_space
    for key in keys or ():
        if key not in known.spaces:
            raise ValueError(f"its normalisation has the key {shown(key)}, which observations lack")
    flags = {name: plain[name] for name in ("norm_obs", "norm_reward")}
    if not all(isinstance(flag, bool) for flag in flags.values()):
        raise ValueError("its normalisation has a flag that is neither true nor false")
    numbers: dict[str, Any] = {name: read_number(plain[name]) for name in _RANGES}
    wrapped = VecNormalize(env, training=False, norm_obs_keys=keys, **flags, **numbers)
    statistics = _statistics(wrapped)
    expected = {f"{name}.{moment}" for name in statistics for moment in ("mean", "var")}
    if set(tensors) != expected or set(plain["counts"]) != set(statistics):
        raise ValueError("the statistics of its normalisation are not those of its observations")
    for name, found in statistics.items():
        found.mean = _moment(tensors[f"{name}.mean"], np.shape(found.mean))
        found.var = _moment(tensors[f"{name}.var"], np.shape(found.var))
        found.count = read_number(plain["counts"][name])
    check_normalization(wrapped)
    return wrapped


def check_normalization(env: VecNormalize) -> None:
    """Refuse a VecNormalize that would show an agent numbers that are not finite, or always the same ones.

    Raises:
        ValueError: naming the setting or the statistic.
    """
    for name, (least, largest) in _RANGES.items():
        value = vars(env)[name]
        if not least <= value <= largest:
            raise ValueError(f"its normalisation has {name}={value}, and {least:g} to {largest:g} is allowed")
    for name, found in _statistics(env).items():
        for moment, least in (("mean", -_LARGEST), ("var", 0.0), ("count", 0.0)):
            numbers = np.asarray(vars(found)[moment])
            if not ((least <= numbers) & (numbers <= _LARGEST)).all():  # nor is NaN
                raise ValueError(f"its normalisation has a {moment} of {name} that is not finite, or out of range")


def _statistics(env: VecNormalize) -> dict[str, RunningMeanStd]:
    """Return the statistics of a VecNormalize by name: of every key that it normalises, and of returns."""
    of_keys: Any = env.obs_rms if env.norm_obs else {}
    return {**{f"observations.{key}": statistics for key, statistics in of_keys.items()}, "returns": env.ret_rms}


def _moment(tensor: Tensor, shape: tuple[int, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    if tensor.dtype != th.float64 or tuple(tensor.shape) != shape:
        raise ValueError(f"its normalisation holds {tensor.dtype} of shape {tuple(tensor.shape)}, not {shape}")
    return np.asarray(tensor.numpy())
