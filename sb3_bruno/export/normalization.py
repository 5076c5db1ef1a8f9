"""Writes the statistics with which VecNormalize shows observations to an agent, and puts them around an env."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch import Tensor

from sb3_bruno.export.plain import read_number, to_plain

_NUMBERS = ("clip_obs", "clip_reward", "gamma", "epsilon")
_SETTINGS = ("norm_obs", "norm_reward", "norm_obs_keys", *_NUMBERS)


def write_normalization(env: VecNormalize) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Write the settings of a VecNormalize, and its statistics by name.

    Raises:
        ValueError: if it is a subclass, which may do something else.
    """
    if type(env) is not VecNormalize:
        raise ValueError(f"the env is normalised by {type(env).__name__}: use VecNormalize itself")
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
        raise ValueError(f"its normalisation has the keys {keys!r:.60}")
    flags = {name: plain[name] for name in ("norm_obs", "norm_reward")}
    numbers: dict[str, Any] = {name: read_number(plain[name]) for name in _NUMBERS}
    is_out = numbers["gamma"] < 0 or min(numbers[name] for name in _NUMBERS if name != "gamma") <= 0
    if not all(isinstance(flag, bool) for flag in flags.values()) or is_out:
        raise ValueError("its normalisation has a setting that is out of range")
    wrapped = VecNormalize(env, training=False, norm_obs_keys=keys, **flags, **numbers)
    statistics = _statistics(wrapped)
    expected = {f"{name}.{moment}" for name in statistics for moment in ("mean", "var")}
    if set(tensors) != expected or set(plain["counts"]) != set(statistics):
        raise ValueError("the statistics of its normalisation are not those of its observations")
    for name, found in statistics.items():
        found.mean = _moment(tensors[f"{name}.mean"], np.shape(found.mean))
        found.var = _moment(tensors[f"{name}.var"], np.shape(found.var))
        found.count = read_number(plain["counts"][name])
        if (found.var < 0).any() or found.count < 0:
            raise ValueError(f"its normalisation of {name} has a variance or a count below 0")
    return wrapped


def _statistics(env: VecNormalize) -> dict[str, RunningMeanStd]:
    """Return the statistics of a VecNormalize by name: of every key that it normalises, and of returns."""
    of_keys: Any = env.obs_rms if env.norm_obs else {}
    return {**{f"observations.{key}": statistics for key, statistics in of_keys.items()}, "returns": env.ret_rms}


def _moment(tensor: Tensor, shape: tuple[int, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    if tensor.dtype != th.float64 or tuple(tensor.shape) != shape:
        raise ValueError(f"its normalisation holds {tensor.dtype} of shape {tuple(tensor.shape)}, not {shape}")
    return np.asarray(tensor.numpy())
