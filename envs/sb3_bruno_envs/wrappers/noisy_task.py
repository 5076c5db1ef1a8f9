"""Shows the hidden task with an error of a given size: what an agent would do with an estimate as good as that."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.wrappers.observations import TaskObservation

_NOISE_STREAM = 1910  # spawn key of the noise generator; that of the tasks has another


class NoisyTaskObservation(TaskObservation):
    """Shows the flat observation, then the task plus noise, in a float32 Box ``(obs_dim + task_dim,)``.

    A control beside the oracle of TaskObservation. An encoder's estimate of the task is wrong by so much after so many
    steps; this shows what an agent earns which is told the task with an error of that size, and infers nothing. The
    error at step t of an episode (or of a trial) is ``std[t]`` times standard normal noise, drawn once for the episode:
    an estimate that errs to one side keeps to it, as an encoder's does, and cannot be averaged away.

    The noise has a generator of its own, so a seed gives the same tasks and episodes as without it.

    Args:
        env: an environment as TaskObservation takes it, with a MetaTask beneath.
        std: standard deviation of the error, in the task's units: a number, ``(n_steps,)``, or ``(n_steps,
            task_dim)``. By steps since the reset; the last row also holds for all later steps.

    Raises:
        ValueError: if ``std`` has another shape, or is negative or not finite; or as TaskObservation.

    Example:
        >>> env = NoisyTaskObservation(gym.make("PointDir-v0", observe="plain"), std=[1.0, 0.5, 0.2])
    """

    def __init__(self, env: gym.Env[Any, Any], std: ArrayLike) -> None:
        RecordConstructorArgs.__init__(self, std=std)
        super().__init__(env)
        tasks: Box = env.get_wrapper_attr("task_space")
        self._task_dim = len(tasks.low)
        self._stds = _read_stds(std, self._task_dim)
        free = np.full(self._task_dim, np.inf, dtype=np.float32)
        shown: Any = self.observation_space
        low, high = (bounds[: -self._task_dim] for bounds in (shown.low, shown.high))
        self.observation_space = Box(np.concatenate([low, -free]), np.concatenate([high, free]))
        self._rng = np.random.default_rng()
        self._noise = np.zeros(self._task_dim)
        self._n_steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Reset the environment, draw noise, and show the new task with it."""
        if seed is not None:
            self._rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_NOISE_STREAM,)))
        self._noise = self._rng.standard_normal(self._task_dim)
        self._n_steps = 0
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[NDArray[np.float32], SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment and show the task of this episode, with the noise of this step's size."""
        self._n_steps += 1
        return super().step(action)

    def _with_task(self, observation: Any, info: dict[str, Any]) -> NDArray[np.float32]:
        std = self._stds[min(self._n_steps, len(self._stds) - 1)]
        return super()._with_task(observation, {**info, "task": info["task"] + std * self._noise})


def _read_stds(std: ArrayLike, task_dim: int) -> NDArray[np.float64]:
    """Return the standard deviations by step, ``(n_steps, task_dim)``."""
    try:
        stds = np.asarray(std, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"std={std!r} holds what is no number: give numbers, or one.") from error
    if stds.ndim < 2:
        stds = np.repeat(stds.reshape(-1, 1), task_dim, axis=1)
    if stds.ndim != 2 or len(stds) == 0 or stds.shape[1] != task_dim:
        raise ValueError(f"std={std!r} is of no use: give a number, (n_steps,) of them, or (n_steps, {task_dim}).")
    if not (np.isfinite(stds).all() and (stds >= 0).all()):
        raise ValueError(f"std={std!r} holds what is no standard deviation: give finite numbers of 0 or more.")
    return stds
