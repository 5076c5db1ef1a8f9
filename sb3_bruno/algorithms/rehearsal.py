"""Plays several tasks on a copy of an environment, before training, and warns if they make no difference.

The environment itself is not touched: neither its generators nor its Monitor's records. Where a copy might touch
anything else (a window, a file, a simulator of its own), there is no rehearsal.
"""

from __future__ import annotations

import inspect
import io
import pickle
import random
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import FunctionType, ModuleType
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from gymnasium.utils import EzPickle
from gymnasium.wrappers import HumanRendering, RecordVideo
from stable_baselines3.common.monitor import Monitor, ResultsWriter
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

_SECONDS = 5.0  # a classic environment takes a few hundredths of one, unless its tasks make no difference
_MOST_BYTES = 50_000_000  # of a copy: an environment may hold a data set

Env = gym.Env[Any, Any]


def warn_of_task_without_effect(env: VecEnv) -> None:
    """Warn if tasks make no difference to the first environment, or leave something behind.

    Says nothing where that cannot be found out: in other processes, without ``MetaTask``, of an environment that cannot
    be copied or is slow.
    """
    inner = env.unwrapped
    if not isinstance(inner, DummyVecEnv):
        return
    with _untouched_generators(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the environment's own come again in training
        try:
            rehearsed = _copy(inner.envs[0])
            problem = rehearsed.get_wrapper_attr("find_task_without_effect")(rehearsed, seconds=_SECONDS)
        except Exception:  # of foreign code; training will tell
            return
    if problem is not None:
        warnings.warn(
            f"The tasks of {inner.envs[0]} are not in force: {problem} "
            "`sb3_bruno_envs.check_meta_env` checks the rest.",
            stacklevel=2,
        )


def _copy(env: Env) -> Env:
    """Copy an environment; its functions and classes stay the same objects.

    Raises:
        Exception: if it cannot be copied, or a copy may not be independent of it.
    """
    if any(layer.render_mode == "human" or isinstance(layer, (HumanRendering, RecordVideo)) for layer in _layers(env)):
        raise pickle.PicklingError("each step would show in a window or a video")
    file = _SmallFile()
    pickler = _Pickler(file)
    pickler.dump(env)
    unpickler = _Unpickler(io.BytesIO(file.getvalue()))
    unpickler.shared = pickler.shared
    copied: Env = unpickler.load()
    for layer in _layers(copied):
        if isinstance(layer, Monitor):
            layer.allow_early_resets = True
    return copied


def _layers(env: Env) -> Iterator[Env]:
    yield env
    while isinstance(env, gym.Wrapper):
        env = env.env
        yield env


class _SmallFile(io.BytesIO):
    """Refuses to grow large."""

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > _MOST_BYTES:
            raise pickle.PicklingError("the environment is too large to be copied for this")
        return super().write(data)


class _Pickler(pickle.Pickler):
    """Pickles what a copy should have of its own, and refuses what might act on the outside."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self.shared: list[Any] = [None]

    def persistent_id(self, obj: Any) -> int | None:
        """Return where in ``shared`` the copy finds the object; None if it gets one of its own."""
        if isinstance(obj, ResultsWriter):
            return 0  # the copy's Monitor writes no file
        if isinstance(obj, (FunctionType, ModuleType, type)):
            if isinstance(obj, FunctionType) and _holds_env(obj):
                raise pickle.PicklingError(f"{obj} holds an environment, which is not the copy")
            self.shared.append(obj)
            return len(self.shared) - 1
        if hasattr(type(obj), "__del__") or _is_built_anew(obj):
            raise pickle.PicklingError(f"{obj} may hold a window, a file or a simulator")
        return None


class _Unpickler(pickle.Unpickler):
    """Puts the shared objects where they were."""

    shared: list[Any]

    def persistent_load(self, pid: int) -> Any:
        return self.shared[pid]


def _holds_env(function: FunctionType) -> bool:
    """Return whether a function refers to an environment, by a variable around it or a global one."""
    variables = inspect.getclosurevars(function)
    found = [*variables.nonlocals.values(), *variables.globals.values()]
    return any(isinstance(value, (gym.Env, VecEnv)) for value in found)


def _is_built_anew(obj: Any) -> bool:
    """Return whether a copy would be made by a constructor that is not Gymnasium's, and may do anything."""
    if not isinstance(obj, EzPickle) or type(obj).__getstate__ is not EzPickle.__getstate__:
        return False
    constructor: Any = type(obj).__init__
    return not constructor.__module__.startswith(("gymnasium.", "gymnasium_robotics."))


@contextmanager
def _untouched_generators() -> Iterator[None]:
    """Give the global generators their states back."""
    state, numpy_state = random.getstate(), np.random.get_state()  # noqa: NPY002
    try:
        with th.random.fork_rng(devices=[]):
            yield
    finally:
        random.setstate(state)
        np.random.set_state(numpy_state)  # noqa: NPY002
