"""Reads the arrays that an agent is given to act on and to infer from, and names what is wrong with them."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.utils import is_vectorized_observation

from sb3_bruno.buffers.numbers import NUMBER_KINDS


def read_observation(observation: Mapping[str, ArrayLike], space: spaces.Dict) -> tuple[dict[str, NDArray[Any]], bool]:
    """Lay an observation of one env or of several out as flat rows.

    Returns:
        Every key of ``space`` as an array (n_envs, dim), and whether the observation was of several envs.

    Raises:
        ValueError: naming a key that is missing, has another shape or holds no numbers.
    """
    for key in (key for key in space if key not in observation):
        raise ValueError(
            f"The observation has no key {key!r}, only {sorted(observation)}: pass what "
            "`sb3_bruno_envs.TransitionObservation` returns, whole."
        )
    arrays = {key: np.asarray(observation[key]) for key in space}
    for key, array in arrays.items():
        if array.dtype.kind not in NUMBER_KINDS:
            raise ValueError(f"The observation's {key!r} is of type {array.dtype}, no array of numbers: give floats.")
    vectorized = is_vectorized_observation(arrays["observation"], space["observation"])
    batch = arrays["observation"].shape[:1] if vectorized else ()
    for key, array in arrays.items():
        wanted = (*batch, *(space[key].shape or ()))
        if array.shape != wanted:
            raise ValueError(f"The observation's {key!r} has shape {array.shape}, expected {wanted}.")
    return {key: array.reshape(batch[0] if batch else 1, -1) for key, array in arrays.items()}, vectorized


def read_episode_start(episode_start: ArrayLike | None, n_envs: int) -> NDArray[np.bool_]:
    """Read where the belief starts again, (n_envs,); None: nowhere.

    It may be the observation's own ``episode_start``, whose 0.5 begins another episode of the same task.

    Raises:
        ValueError: if it is of another number of envs, or holds anything but True, False, 0, 0.5 and 1.
    """
    if episode_start is None:
        return np.zeros(n_envs, dtype=bool)
    given = np.asarray(episode_start)
    if given.dtype.kind not in NUMBER_KINDS or not (given.dtype == bool or np.isin(given, (0, 0.5, 1)).all()):
        raise ValueError(f"`episode_start={episode_start!r}` says neither yes nor no: give True where the task is new.")
    fresh: NDArray[np.bool_] = given == 1
    if fresh.size != n_envs:
        raise ValueError(f"`episode_start` is of {fresh.size} envs, the observation of {n_envs}: give one for each.")
    return fresh.reshape(n_envs)


def read_batch(
    arrays: Mapping[str, ArrayLike], shapes: Mapping[str, tuple[int, ...]], batch: tuple[int, ...] | None = None
) -> dict[str, NDArray[np.float32]]:
    """Give arrays one batch shape before the shapes of their entries, which they may have flat.

    Args:
        arrays: by name.
        shapes: of an entry of each.
        batch: the batch shape. None: the one that most of the arrays have, so that an error names the odd one out.

    Raises:
        ValueError: naming an array that does not fit.
    """
    found = {name: read_numbers(name, array) for name, array in arrays.items()}
    possible = {name: _batch_shapes(array.shape, shapes[name]) for name, array in found.items()}
    if batch is None:
        counts = Counter(shape for candidates in possible.values() for shape in candidates)
        batch = counts.most_common(1)[0][0] if counts else ()
    for name, array in found.items():
        if batch not in possible[name]:
            wanted = ", ".join(map(str, (*(batch if any(possible.values()) else ("...",)), math.prod(shapes[name]))))
            raise ValueError(f"`{name}` has shape {array.shape}, expected ({wanted}).")
    return {name: array.reshape(*batch, *shapes[name]) for name, array in found.items()}


def read_numbers(name: str, array: ArrayLike) -> NDArray[np.float32]:
    """Make an array of what a user gave for one.

    Raises:
        ValueError: naming it, if it holds something else than numbers, or rows of different lengths.
    """
    try:
        with np.errstate(over="ignore"):  # what overflows is refused as infinite
            return np.asarray(array, dtype=np.float32)
    except (TypeError, ValueError, RuntimeError) as error:  # the last of a tensor with a graph
        raise ValueError(f"`{name}` is no array of numbers ({error}): give floats, all rows alike.") from error


def _batch_shapes(shape: tuple[int, ...], entry: tuple[int, ...]) -> set[tuple[int, ...]]:
    """Return what may come before an entry, in its own shape or flat, in an array of some shape."""
    endings = {entry, (math.prod(entry),)}
    return {shape[: len(shape) - len(end)] for end in endings if shape[len(shape) - len(end) :] == end}


def warn_of_state(start: NDArray[Any], fresh: NDArray[np.bool_], *, has_state: bool) -> None:
    """Warn whoever calls ``predict`` and has lost the state, or keeps that of another task.

    Args:
        start: the observation's own ``episode_start``, (n_envs,): 1 at the reset of a task, 0.5 where another episode
            of the same task begins.
        fresh: where the caller begins anew, (n_envs,).
        has_state: whether a state was passed.
    """
    if not has_state and not (start > 0).all():
        warnings.warn(
            "`predict` was called in mid-episode without `state`, so the agent acts on its prior: pass back the state "
            "that the last call returned.",
            stacklevel=5,
        )
    if has_state and ((start == 1.0) & ~fresh).any():
        warnings.warn(
            "`predict` was called with a `state` from before the env's reset, so the agent takes the new task for the "
            "old one: pass `episode_start=True` there. `sb3_bruno_envs.Trial` joins episodes of one task.",
            stacklevel=5,
        )
