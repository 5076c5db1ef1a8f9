"""Saves environments in the middle of an episode, with their wrappers and monitor files, and restores them."""

from __future__ import annotations

import io
import pickle
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import cloudpickle
from gymnasium import Env, Wrapper
from gymnasium.utils import EzPickle
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper, VecMonitor, VecNormalize

_PER_PROCESS = {"class_attributes", "results_writer"}
"""VecEnvWrapper attributes that belong to one process and must not be restored in another."""


class WrapperState(NamedTuple):
    """A VecEnvWrapper as it was saved.

    Attributes:
        kind: the class of the wrapper.
        attributes: the wrapper's attributes, pickled; None if they cannot be pickled.
    """

    kind: type[VecEnvWrapper]
    attributes: bytes | None


class MonitorState(NamedTuple):
    """A Monitor as it was saved.

    Attributes:
        file_size: bytes written to the monitor file so far; 0 without a file.
        seconds: seconds that the Monitor's clock had run.
    """

    file_size: int
    seconds: float


class EnvState(NamedTuple):
    """The environments of a training run as they were saved.

    Attributes:
        envs: the environments, pickled; None if they cannot be pickled.
        missing_because: why ``envs`` is None; empty otherwise.
        wrappers: the VecEnvWrappers around the environments, outermost first.
        monitors: the Monitors, in the order of the environments; None if they live in other processes.
    """

    envs: bytes | None
    missing_because: str
    wrappers: list[WrapperState]
    monitors: list[MonitorState] | None


def save_envs(vec_env: VecEnv) -> EnvState:
    """Save the environments inside ``vec_env``, its wrappers and the progress of its Monitors."""
    inner = vec_env.unwrapped
    places = {id(part): place for place, part in enumerate(_parts(vec_env))}
    wrappers = [_save_wrapper(wrapper, places) for wrapper in _wrappers(vec_env)]
    if not isinstance(inner, DummyVecEnv):
        why = f"the state of envs inside {type(inner).__name__} cannot be reached"
        return EnvState(None, why, wrappers, None)
    monitors = _monitors(inner)
    states = [_save_monitor(monitor) for monitor in monitors]
    try:
        _check_wrappers(wrappers)
        with _no_open_files(monitors):
            return EnvState(_pickle_envs(inner), "", wrappers, states)
    except _NotPickled as error:
        return EnvState(None, str(error), wrappers, states)


def wrapped_alike(vec_env: VecEnv, states: list[WrapperState]) -> VecEnv:
    """Return ``vec_env``; if only the outermost VecNormalize is missing, one is put around it.

    Raises:
        ValueError: if the wrappers are not those that were saved.
    """
    wanted = [state.kind for state in states]
    if wanted == [VecNormalize, *map(type, _wrappers(vec_env))]:
        vec_env = VecNormalize(vec_env, norm_obs=False)
    given = [type(wrapper) for wrapper in _wrappers(vec_env)]
    if given != wanted:
        raise ValueError(
            f"env is wrapped in {_names(given)}, outermost first, the checkpoint's in {_names(wanted)}: wrap it alike."
        )
    return vec_env


def restore_envs(vec_env: VecEnv, state: EnvState) -> str:
    """Replace the environments inside ``vec_env`` by the saved ones, which write on in the new ones' monitor files.

    A monitor file that was opened for appending is cut off where it ended when the state was saved. The clocks of the
    Monitors continue from what they showed then. If the environments could not be saved, the new ones stay, and only
    files and clocks are restored. In other processes nothing can be restored.

    Returns:
        Why the new environments stay; empty if the saved ones replaced them.

    Raises:
        ValueError: if ``vec_env`` has another number of Monitors than were saved.
    """
    inner = vec_env.unwrapped
    if not isinstance(inner, DummyVecEnv):
        return state.missing_because or f"saved envs cannot be put into {type(inner).__name__}"
    if state.monitors is None:
        return state.missing_because
    new = _monitors(inner)
    if len(new) != len(state.monitors):
        raise ValueError(
            f"env has {len(new)} Monitors, the checkpoint {len(state.monitors)}: make the envs as they were made first."
        )
    for monitor, saved in zip(new, state.monitors, strict=True):
        _cut_file(monitor, saved.file_size)
    if state.envs is not None:
        inner.envs = cloudpickle.loads(state.envs)
        for restored, monitor in zip(_monitors(inner), new, strict=True):
            restored.results_writer = monitor.results_writer
    for monitor, saved in zip(_monitors(inner), state.monitors, strict=True):
        monitor.t_start = time.time() - saved.seconds
    return state.missing_because


def restore_wrappers(vec_env: VecEnv, states: list[WrapperState]) -> None:
    """Give the wrappers of ``vec_env``, whose environments are restored, the attributes that they were saved with.

    An attribute that was a part of the old ``vec_env`` becomes the same part of this one. The clock of a VecMonitor
    continues.
    """
    parts = _parts(vec_env)
    for wrapper, state in zip(_wrappers(vec_env), states, strict=True):
        if state.attributes is not None:
            vars(wrapper).update(_Unpickler(state.attributes, parts).load())
            if isinstance(wrapper, VecMonitor):
                wrapper.t_start += time.time()  # saved as minus the seconds that its clock had run


class _Pickler(cloudpickle.Pickler):  # type: ignore[misc]  # it has no types
    """Pickles the parts of a VecEnv as their places."""

    def __init__(self, file: io.BytesIO, places: dict[int, int]) -> None:
        super().__init__(file)
        self._places = places

    def persistent_id(self, part: Any) -> int | None:
        return self._places.get(id(part))


class _Unpickler(pickle.Unpickler):
    """Finds the parts of a VecEnv by their places."""

    def __init__(self, pickled: bytes, parts: list[Any]) -> None:
        super().__init__(io.BytesIO(pickled))
        self._parts = parts

    def persistent_load(self, place: int) -> Any:
        return self._parts[place]


class _NotPickled(Exception):
    """Raised with the reason why the environments cannot be saved."""


def _save_wrapper(wrapper: VecEnvWrapper, places: dict[int, int]) -> WrapperState:
    """Pickle the attributes of a wrapper, except those that belong to this process; parts of the VecEnv as places."""
    kept = {name: value for name, value in vars(wrapper).items() if name not in _PER_PROCESS}
    if isinstance(wrapper, VecMonitor):
        kept["t_start"] -= time.time()
    pickled = io.BytesIO()
    try:
        _Pickler(pickled, places).dump(kept)
        return WrapperState(type(wrapper), pickled.getvalue())
    except Exception:  # a user's wrapper may raise anything when it is pickled
        return WrapperState(type(wrapper), None)


def _save_monitor(monitor: Monitor[Any, Any]) -> MonitorState:
    """Note how far the file and the clock of a Monitor have come."""
    writer = monitor.results_writer
    return MonitorState(0 if writer is None else writer.file_handler.tell(), time.time() - monitor.t_start)


def _check_wrappers(wrappers: list[WrapperState]) -> None:
    """Raise _NotPickled if a wrapper lost its attributes: a restored environment would no longer fit to it."""
    for kind, attributes in wrappers:
        if attributes is None:
            raise _NotPickled(f"{kind.__name__} cannot be pickled")


def _pickle_envs(vec_env: DummyVecEnv) -> bytes:
    """Pickle the environments; raise _NotPickled if that fails or would lose their state."""
    for layer in (layer for env in vec_env.envs for layer in _layers(env)):
        # EzPickle keeps only the constructor's arguments and makes a new environment of them.
        if isinstance(layer, EzPickle) and type(layer).__getstate__ is EzPickle.__getstate__:
            raise _NotPickled(f"{type(layer).__name__} pickles its constructor's arguments, not its state")
    try:
        return bytes(cloudpickle.dumps(vec_env.envs))
    except Exception as error:  # a user's environment may raise anything when it is pickled
        raise _NotPickled(f"the envs cannot be pickled ({error})") from error


@contextmanager
def _no_open_files(monitors: list[Monitor[Any, Any]]) -> Iterator[None]:
    """Take the files away from the Monitors for a while: an open file cannot be pickled."""
    writers = [monitor.results_writer for monitor in monitors]
    for monitor in monitors:
        monitor.results_writer = None
    try:
        yield
    finally:
        for monitor, writer in zip(monitors, writers, strict=True):
            monitor.results_writer = writer


def _cut_file(monitor: Monitor[Any, Any], size: int) -> None:
    """Cut off what was written to an appended monitor file beyond ``size`` bytes."""
    writer = monitor.results_writer
    if writer is not None and writer.file_handler.mode.startswith("a"):
        writer.file_handler.truncate(min(size, writer.file_handler.tell()))


def _parts(vec_env: VecEnv) -> list[Any]:
    """List what a wrapper may hold under names of its own: VecEnvs, outermost first, and the environments inside."""
    parts: list[Any] = [*_wrappers(vec_env), vec_env.unwrapped]
    if isinstance(vec_env.unwrapped, DummyVecEnv):
        envs = vec_env.unwrapped.envs
        parts += [envs, *(layer for env in envs for layer in _layers(env))]
    return parts


def _wrappers(vec_env: VecEnv) -> list[VecEnvWrapper]:
    """List the wrappers around a VecEnv, outermost first."""
    wrappers = []
    while isinstance(vec_env, VecEnvWrapper):
        wrappers.append(vec_env)
        vec_env = vec_env.venv
    return wrappers


def _names(kinds: list[type[VecEnvWrapper]]) -> list[str]:
    return [kind.__name__ for kind in kinds]


def _monitors(vec_env: DummyVecEnv) -> list[Monitor[Any, Any]]:
    """List the Monitors in all environments, in the order of the environments."""
    return [layer for env in vec_env.envs for layer in _layers(env) if isinstance(layer, Monitor)]


def _layers(env: Env[Any, Any]) -> list[Env[Any, Any]]:
    """List an environment's wrappers, outermost first, and the environment itself last."""
    layers = [env]
    while isinstance(layers[-1], Wrapper):
        layers.append(layers[-1].env)
    return layers
