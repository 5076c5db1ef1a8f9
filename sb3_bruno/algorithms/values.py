"""Refuses arguments of the algorithms whose values are of a wrong kind, or count less than can be.

SB3 takes any value at construction, and fails at it in the middle of a training. Knows no algorithm.
"""

from __future__ import annotations

import inspect
import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from numbers import Real
from operator import index
from typing import Any, TypeGuard

import numpy as np
import torch as th
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.utils import get_device

LEAST = {
    "batch_size": 1,
    "buffer_size": 1,
    "gradient_steps": -1,
    "learning_starts": 0,
    "n_critics": 1,
    "n_quantiles": 1,
    "n_recent": 1,
    "n_sequences": 1,
    "n_steps": 1,
    "policy_delay": 1,
    "sde_sample_freq": -1,
    "seed": 0,
    "sequence_length": 1,
    "stats_window_size": 1,
    "target_update_interval": 1,
    "top_quantiles_to_drop_per_net": 0,
    "verbose": 0,
}
"""The least value of arguments that count something."""
WHOLE = {*LEAST, "encoder_batch_size", "encoder_learning_starts"}  # the encoder's have bounds elsewhere
STEPS = {"learning_starts", "encoder_learning_starts"}
NUMBERS = {
    "clip_mean",
    "encoder_tau",
    "encoder_update_ratio",
    "forget_threshold",
    "gamma",
    "log_std_init",
    "target_noise_clip",
    "target_policy_noise",
    "tau",
}
RATES = {"learning_rate", "encoder_learning_rate"}
RANGES = {
    "learning_rate": (0.0, 1e3),
    "encoder_learning_rate": (0.0, 1e3),
    "gamma": (0.0, 1.0),
    "tau": (0.0, 1.0),
    "ent_coef": (0.0, 1e9),
    "target_entropy": (-1e9, 1e9),
    "target_policy_noise": (0.0, math.inf),
    "target_noise_clip": (0.0, math.inf),
}
"""The least and the greatest value of numbers."""
DICTS = {"encoder_kwargs", "policy_kwargs", "replay_buffer_kwargs"}
FLAGS = {
    "handle_timeout_termination",
    "optimize_memory_usage",
    "task_readout",
    "use_expln",
    "use_sde",
    "use_sde_at_warmup",
}
NEVER_NONE = {*(LEAST.keys() - {"seed"}), *(RANGES.keys() - {"encoder_learning_rate"}), "tau", "train_freq"}


def check_values(given: Mapping[str, Any]) -> None:
    """Refuse values that cannot be meant. Names that are not known are skipped.

    Args:
        given: arguments of an algorithm by name.

    Raises:
        TypeError: if a value is of a wrong kind.
        ValueError: if it is out of range.
    """
    for name, value in given.items():
        if value is None and name not in NEVER_NONE:
            continue
        if name in WHOLE:
            check_whole(name, _as_whole(name, value), LEAST.get(name))
        elif name in NUMBERS and not is_number(value):
            raise TypeError(f"`{name}={value!r}` is no number: give one, such as 0.9.")
        elif name in RATES and not (is_number(value) or callable(value)):
            raise TypeError(f"`{name}={value!r}` is no number and no schedule: give one, such as 1e-3.")
        elif name in DICTS and not isinstance(value, Mapping):
            raise TypeError(f"`{name}={value!r}` is no dict: give the arguments by name, such as `{name}={{...}}`.")
        elif name in FLAGS and not isinstance(value, bool):
            raise TypeError(f"`{name}={value!r}` is neither True nor False: give one of them.")
        elif name in SPECIAL:
            SPECIAL[name](name, value)


def check_env(env: object, *, is_loading: bool) -> None:
    """Refuse to begin without an env. ``load`` may have none.

    Raises:
        ValueError: if there is none.
    """
    if env is None and not is_loading:
        raise ValueError("`env=None` has no observations to learn from: give an env, or the id of one.")


def check_none(given: Mapping[str, Any] | None, takes: Callable[..., Any]) -> None:
    """Refuse None where it is neither the default nor named by the annotation.

    Args:
        given: arguments by name.
        takes: the constructor.

    Raises:
        TypeError: naming the default.
    """
    parameters = inspect.signature(takes).parameters
    for name in (name for name, value in (given or {}).items() if value is None and name in parameters):
        default = parameters[name].default
        if default is not None and "None" not in str(parameters[name].annotation):
            remedy = "give one." if default is inspect.Parameter.empty else f"leave it out for {default!r}."
            raise TypeError(f"`{name}=None` is no value of it: {remedy}")


def check_kinds(given: Mapping[str, Any] | None, takes: Callable[..., Any]) -> None:
    """Refuse None, and values of another kind than numbers, True or False, where the default of a constructor is one.

    Args:
        given: arguments by name.
        takes: the constructor.

    Raises:
        TypeError: naming argument, value and remedy.
    """
    check_none(given, takes)
    defaults = {name: parameter.default for name, parameter in inspect.signature(takes).parameters.items()}
    for name, value in (given or {}).items():
        default = defaults.get(name)
        if value is None:
            continue
        if isinstance(default, bool):
            if not isinstance(value, bool | np.bool_):
                raise TypeError(f"`{name}={value!r}` is neither True nor False: give one of them.")
        elif isinstance(default, int):
            check_whole(name, value)
        elif isinstance(default, float) and not is_number(value):
            raise TypeError(f"`{name}={value!r}` is no number: give one, such as {default}.")


def _as_whole(name: str, value: Any) -> Any:
    """Return what SB3 takes for a whole number as one: 1e4 steps, and True for ``verbose``."""
    is_taken = isinstance(value, bool) if name == "verbose" else name in STEPS and is_number(value)
    return int(value) if is_taken and value % 1 == 0 else value


def check_whole(name: str, value: Any, least: int | None = None) -> None:
    """Refuse all but a whole number.

    Raises:
        TypeError: if it is none.
        ValueError: if it is below ``least``.
    """
    remedy = "give a whole number" + ("." if least is None else f" of {least} or more.")
    try:
        whole = index(value)
    except TypeError as error:
        raise TypeError(f"`{name}={value!r}` is no whole number: {remedy}") from error
    if isinstance(value, bool):
        raise TypeError(f"`{name}={value!r}` is no whole number: {remedy}")
    if least is not None and whole < least:
        raise ValueError(f"`{name}={value!r}` is too small: {remedy}")


def check_ranges(arguments: Mapping[str, Any]) -> None:
    """Refuse numbers that are NaN, or out of the range in which training makes sense.

    Args:
        arguments: of an algorithm, by name; what has no range is only looked at for NaN.

    Raises:
        ValueError: naming the argument and its value.
    """
    for name, value in _floats(arguments):
        if math.isnan(value):
            raise ValueError(f"`{name}={value}` is no number: give one.")
    for name, (low, high) in RANGES.items():
        given = arguments.get(name)
        if is_number(given) and not low <= given <= high:
            raise ValueError(f"`{name}={given}` is out of range: give a number from {low:g} to {high:g}.")


def _floats(arguments: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield floats by name, also those in keyword arguments within."""
    for name, value in arguments.items():
        if isinstance(value, (float, np.floating)):
            yield name, float(value)
        elif str(name).endswith("_kwargs") and isinstance(value, Mapping):
            yield from _floats(value)


def check_learning(total_timesteps: Any, log_interval: Any) -> None:
    """Refuse arguments of ``learn`` that would end it at once in silence, or at its first episode's end.

    Raises:
        TypeError: if one is of a wrong kind.
        ValueError: if one is a number that cannot be meant.
    """
    if not is_number(total_timesteps):
        raise TypeError(f"`total_timesteps={total_timesteps!r}` is no number: give that of env steps, such as 10_000.")
    if math.isnan(total_timesteps) or total_timesteps < 0:
        raise ValueError(f"`total_timesteps={total_timesteps!r}` is none: give a number of env steps, such as 10_000.")
    if log_interval is not None:
        check_whole("log_interval", log_interval)
        if log_interval == 0:
            raise ValueError(
                "`log_interval=0` is no interval: give a whole number of episodes, or None to log nothing."
            )


def is_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a number, and neither True nor False."""
    return isinstance(value, Real) and not isinstance(value, bool)


def _check_train_freq(name: str, value: Any) -> None:
    freq, unit = value if isinstance(value, tuple | list) and len(value) == 2 else (value, "step")
    try:
        check_whole(name, freq, 1)
    except TypeError:
        unit = ""
    if unit not in ("step", "episode"):
        raise ValueError(f"`{name}={value!r}` is unknown: give a whole number, or (a number, 'step' or 'episode').")


def _check_coefficient(name: str, value: Any) -> None:
    kinds = "a number or 'auto'" if name == "target_entropy" else "a number, 'auto' or 'auto_0.1'"
    first = str(value).removeprefix("auto_") if name == "ent_coef" and str(value).startswith("auto_") else None
    try:
        known = is_number(value) or value == "auto" or (first is not None and 0 < float(first) < math.inf)
    except ValueError:
        known = False
    if not known:
        raise ValueError(f"`{name}={value!r}` is unknown: give {kinds}.")


def _check_action_noise(name: str, value: Any) -> None:
    if not isinstance(value, ActionNoise):
        raise TypeError(f"`{name}={value!r}` is no `ActionNoise`: give one, such as `NormalActionNoise`.")


def _check_buffer_class(name: str, value: Any) -> None:
    if not isinstance(value, type):
        raise TypeError(f"`{name}={value!r}` is no class: give a subclass of `TaskReplayBuffer`, or leave it out.")


def _check_tensorboard_log(name: str, value: Any) -> None:
    if not isinstance(value, str | os.PathLike):
        raise TypeError(f"`{name}={value!r}` is no path: give that of a folder.")


def warn_of_missing_gpu(device: Any) -> None:
    """Warn that the CPU takes the place of a GPU that torch does not find, as SB3 has it without a word."""
    if str(device).startswith("cuda") and get_device(device).type != "cuda":
        warnings.warn(
            f"`device={str(device)!r}`: torch finds no GPU here, so the CPU is used. Install torch with CUDA, or give "
            "'auto' or 'cpu'.",
            stacklevel=4,
        )


def _check_device(name: str, value: Any) -> None:
    try:
        th.empty(0, device=get_device(value))
    except Exception as error:  # torch raises several kinds
        raise ValueError(f"`{name}={value!r}` is no device that torch finds: give 'auto', 'cpu' or 'cuda'.") from error


SPECIAL: dict[str, Callable[[str, Any], None]] = {
    "action_noise": _check_action_noise,
    "device": _check_device,
    "ent_coef": _check_coefficient,
    "target_entropy": _check_coefficient,
    "replay_buffer_class": _check_buffer_class,
    "tensorboard_log": _check_tensorboard_log,
    "train_freq": _check_train_freq,
}
"""Checks of arguments that are like no other."""
