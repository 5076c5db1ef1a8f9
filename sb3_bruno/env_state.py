"""The state of environments in mid-episode, and of their monitor files, as something that can be pickled."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import cloudpickle
from gymnasium import Env, Wrapper
from gymnasium.utils import EzPickle
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv


class EnvState(NamedTuple):
    """:ivar envs: the environments, pickled; None if they cannot be
    :ivar missing_because: why not
    :ivar monitor_sizes: how far each Monitor's file had been written, in bytes; 0 where there is none
    :ivar monitor_seconds: for how long each Monitor's clock had run
    """

    envs: bytes | None
    missing_because: str
    monitor_sizes: list[int]
    monitor_seconds: list[float]


def save_envs(vec_env: VecEnv | None) -> EnvState:
    """The state of the environments inside ``vec_env`` and whatever wraps it."""
    inner = None if vec_env is None else vec_env.unwrapped
    if not isinstance(inner, DummyVecEnv):
        return EnvState(None, f"the state of envs inside {type(inner).__name__} cannot be reached", [], [])
    writers = [monitor.results_writer for monitor in _monitors(inner)]
    sizes = [0 if writer is None else writer.file_handler.tell() for writer in writers]
    seconds = [time.time() - monitor.t_start for monitor in _monitors(inner)]
    for env in inner.envs:
        for layer in _layers(env):
            # EzPickle makes a new env of the constructor's arguments: the state in between is lost.
            if isinstance(layer, EzPickle) and type(layer).__getstate__ is EzPickle.__getstate__:
                why = f"{type(layer).__name__} pickles its constructor's arguments, not its state"
                return EnvState(None, why, sizes, seconds)
    _set_writers(inner, [None] * len(writers))  # an open file cannot be pickled
    try:
        return EnvState(cloudpickle.dumps(inner.envs), "", sizes, seconds)
    except Exception as error:  # whatever a user's env raises when it is pickled
        return EnvState(None, f"the envs cannot be pickled ({error})", sizes, seconds)
    finally:
        _set_writers(inner, writers)


def restore_envs(vec_env: VecEnv, state: EnvState) -> None:
    """Put saved environments in the place of new ones, whose monitor files they go on to write.

    Of a file that was opened to be appended to, what was written after the state was saved is cut off. The Monitors'
    clocks go on from where they were saved.
    """
    inner = vec_env.unwrapped
    if not isinstance(inner, DummyVecEnv):
        return
    writers = [monitor.results_writer for monitor in _monitors(inner)]
    for writer, size in zip(writers, state.monitor_sizes, strict=False):  # none known of subprocesses
        if writer is not None and writer.file_handler.mode.startswith("a"):
            writer.file_handler.truncate(min(size, writer.file_handler.tell()))
    if state.envs is not None:
        inner.envs = cloudpickle.loads(state.envs)
        _set_writers(inner, writers)
        inner._reset_seeds()
    for monitor, seconds in zip(_monitors(inner), state.monitor_seconds, strict=False):
        monitor.t_start = time.time() - seconds


def _set_writers(vec_env: DummyVecEnv, writers: list[Any]) -> None:
    for monitor, writer in zip(_monitors(vec_env), writers, strict=True):
        monitor.results_writer = writer


def _monitors(vec_env: DummyVecEnv) -> list[Monitor[Any, Any]]:
    return [layer for env in vec_env.envs for layer in _layers(env) if isinstance(layer, Monitor)]


def _layers(env: Env[Any, Any]) -> list[Env[Any, Any]]:
    layers = [env]
    while isinstance(layers[-1], Wrapper):
        layers.append(layers[-1].env)
    return layers
