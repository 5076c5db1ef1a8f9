"""The state of environments in mid-episode, of what wraps them and of their monitor files, to be pickled."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import cloudpickle
from gymnasium import Env, Wrapper
from gymnasium.utils import EzPickle
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper, VecMonitor, VecNormalize

_OF_A_PROCESS = {"venv", "class_attributes", "results_writer"}
"""Attributes of a VecEnvWrapper that another process has its own of."""


class WrapperState(NamedTuple):
    """:ivar kind: the class of a VecEnvWrapper
    :ivar attributes: its own, pickled; None if they cannot be
    """

    kind: type[VecEnvWrapper]
    attributes: bytes | None


class EnvState(NamedTuple):
    """:ivar envs: the environments, pickled; None if they cannot be
    :ivar missing_because: why not
    :ivar wrappers: of the VecEnvWrappers around them, outermost first
    :ivar monitor_sizes: how far each Monitor's file had been written, in bytes; 0 where there is none
    :ivar monitor_seconds: for how long each Monitor's clock had run
    """

    envs: bytes | None
    missing_because: str
    wrappers: list[WrapperState]
    monitor_sizes: list[int]
    monitor_seconds: list[float]


def save_envs(vec_env: VecEnv) -> EnvState:
    """The state of the environments inside ``vec_env`` and whatever wraps it."""
    inner = vec_env.unwrapped
    wrappers = [WrapperState(type(wrapper), _attributes(wrapper)) for wrapper in _wrappers(vec_env)]
    if not isinstance(inner, DummyVecEnv):
        why = f"the state of envs inside {type(inner).__name__} cannot be reached"
        return EnvState(None, why, wrappers, [], [])
    writers = [monitor.results_writer for monitor in _monitors(inner)]
    sizes = [0 if writer is None else writer.file_handler.tell() for writer in writers]
    seconds = [time.time() - monitor.t_start for monitor in _monitors(inner)]
    _set_writers(inner, [None] * len(writers))  # an open file cannot be pickled
    try:
        return EnvState(_pickled(inner, wrappers), "", wrappers, sizes, seconds)
    except _NotPickled as error:
        return EnvState(None, str(error), wrappers, sizes, seconds)
    finally:
        _set_writers(inner, writers)


def restore_envs(vec_env: VecEnv, state: EnvState) -> None:
    """Put saved environments in the place of new ones, whose monitor files they go on to write.

    Of a file that was opened to be appended to, what was written after the state was saved is cut off. The Monitors'
    clocks go on from where they were saved.

    :raises ValueError: if ``vec_env`` has another number of Monitors
    """
    inner = vec_env.unwrapped
    if not isinstance(inner, DummyVecEnv):
        return
    writers = [monitor.results_writer for monitor in _monitors(inner)]
    if len(writers) != len(state.monitor_sizes) and state.monitor_sizes:  # none known of subprocesses
        raise ValueError(
            f"`env` has {len(writers)} Monitors, the checkpoint {len(state.monitor_sizes)}: make the envs as they were."
        )
    for writer, size in zip(writers, state.monitor_sizes, strict=False):
        if writer is not None and writer.file_handler.mode.startswith("a"):
            writer.file_handler.truncate(min(size, writer.file_handler.tell()))
    if state.envs is not None:
        inner.envs = cloudpickle.loads(state.envs)
        _set_writers(inner, writers)
        inner._reset_seeds()
    for monitor, seconds in zip(_monitors(inner), state.monitor_seconds, strict=False):
        monitor.t_start = time.time() - seconds


def restore_wrappers(vec_env: VecEnv, states: list[WrapperState]) -> VecEnv:
    """Put saved attributes in the place of those of new wrappers; a VecMonitor's clock goes on.

    :return: ``vec_env``, in the VecNormalize that was outermost where just that was left out
    :raises ValueError: if ``vec_env`` is otherwise wrapped than the environments were
    """
    kinds = [state.kind for state in states]
    if kinds == [VecNormalize, *map(type, _wrappers(vec_env))]:
        vec_env = VecNormalize(vec_env, norm_obs=False)
    found = _wrappers(vec_env)
    if kinds != [type(wrapper) for wrapper in found]:
        given, wanted = ([kind.__name__ for kind in ones] for ones in (map(type, found), kinds))
        raise ValueError(f"`env` is wrapped in {given}, outermost first, the checkpoint's in {wanted}: wrap it alike.")
    for wrapper, state in zip(found, states, strict=True):
        if state.attributes is not None:
            vars(wrapper).update(cloudpickle.loads(state.attributes))
        if isinstance(wrapper, VecMonitor) and state.attributes is not None:
            wrapper.t_start += time.time()
    return vec_env


class _NotPickled(Exception):
    """Says why the environments' state is lost."""


def _pickled(inner: DummyVecEnv, wrappers: list[WrapperState]) -> bytes:
    for kind, attributes in wrappers:
        if attributes is None:
            raise _NotPickled(f"{kind.__name__} cannot be pickled")
    for layer in (layer for env in inner.envs for layer in _layers(env)):
        # EzPickle makes a new env of the constructor's arguments: the state in between is lost.
        if isinstance(layer, EzPickle) and type(layer).__getstate__ is EzPickle.__getstate__:
            raise _NotPickled(f"{type(layer).__name__} pickles its constructor's arguments, not its state")
    try:
        return bytes(cloudpickle.dumps(inner.envs))
    except Exception as error:  # whatever a user's env raises when it is pickled
        raise _NotPickled(f"the envs cannot be pickled ({error})") from error


def _wrappers(vec_env: VecEnv) -> list[VecEnvWrapper]:
    """Outermost first."""
    wrappers = []
    while isinstance(vec_env, VecEnvWrapper):
        wrappers.append(vec_env)
        vec_env = vec_env.venv
    return wrappers


def _attributes(wrapper: VecEnvWrapper) -> bytes | None:
    held = {name: value for name, value in vars(wrapper).items() if name not in _OF_A_PROCESS}
    if isinstance(wrapper, VecMonitor):
        held["t_start"] -= time.time()
    try:
        return bytes(cloudpickle.dumps(held))
    except Exception:  # whatever a user's wrapper raises when it is pickled
        return None


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
