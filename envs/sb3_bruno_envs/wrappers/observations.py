"""Shows the last transition to an agent that infers the task, or the task to an oracle; knows no environment."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box, Dict, Tuple, flatdim, flatten, flatten_space
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.arguments import check_env
from sb3_bruno_envs.wrappers.trial import check_ends_are_shown


class TransitionObservation(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Shows the last transition, so that an agent which receives observations alone can infer the task.

    The observation becomes a Dict of float32 Boxes:

    - ``observation``: the environment's own, of the same shape; any that is no Box is flattened as Gymnasium does it:
      the entries of a Dict by the order of its keys, a number of a Discrete one-hot;
    - ``action``: the last action, flat, ``(action_dim,)``, clipped and scaled from its bounds to [-1, 1];
    - ``reward``: the last reward, ``(1,)``;
    - ``episode_start``: ``(1,)``, 1 after a reset and 0 after a step, unless that step began a trial's next
      episode: then 0.5, because it is not the last action that led to ``observation``, but the task is the same.

    After a reset, ``action`` and ``reward`` are zeros.

    Args:
        env: an environment with a bounded Box action, whose observation is a Box, Discrete, MultiDiscrete or
            MultiBinary, or a Dict or Tuple of these.

    Attributes:
        episode_steps: steps since the last reset, over all episodes of a trial.

    Raises:
        ValueError: if the observation is none of these or holds a uint8 image, or the action is no Box or not bounded,
            or an observation wrapper is around a Trial.

    Example:
        >>> env = TransitionObservation(gym.make("Pendulum-v1"))
        >>> list(env.observation_space)
        ['action', 'episode_start', 'observation', 'reward']
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        check_env(env)
        check_ends_are_shown(env)
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        actions = _bounded_actions(env.action_space)
        self._action_low = actions.low.ravel()  # (action_dim,)
        self._action_high = actions.high.ravel()  # (action_dim,)
        self._per_unit = 2.0 / (self._action_high - self._action_low)  # (action_dim,)
        self.episode_steps = 0
        self.observation_space = Dict(
            {
                "action": Box(-1.0, 1.0, self._action_low.shape),
                "episode_start": Box(0.0, 1.0, (1,)),
                "observation": _vector_space(env.observation_space),
                "reward": Box(-np.inf, np.inf, (1,)),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        """Reset the environment; there is no last action or reward yet."""
        observation, info = self.env.reset(seed=seed, options=options)
        self.episode_steps = 0
        no_action = np.zeros_like(self._action_low)
        return self._show(observation, no_action, 0.0, episode_start=1.0), info

    def step(self, action: Any) -> tuple[dict[str, NDArray[np.float32]], SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment and show the action and the reward of this step."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.episode_steps += 1
        begins = 0.0
        if "trial_final_observation" in info:  # Trial marks an inner start so
            begins = 0.5
            final = _as_vector(info["trial_final_observation"], self.env.observation_space)
            info = {**info, "trial_final_observation": final}
        seen = self._show(observation, self._scale(action), float(reward), episode_start=begins)
        return seen, reward, terminated, truncated, info

    def _show(
        self, observation: Any, action: ArrayLike, reward: float, episode_start: float
    ) -> dict[str, NDArray[np.float32]]:
        """Return the four entries as new float32 arrays."""
        return {
            "action": np.array(action, dtype=np.float32),
            "episode_start": np.array([episode_start], dtype=np.float32),
            "observation": _as_vector(observation, self.env.observation_space),
            "reward": np.array([reward], dtype=np.float32),
        }

    def _scale(self, action: ArrayLike) -> ArrayLike:
        """Clip ``action`` into its bounds and map it linearly onto [-1, 1], flat, ``(action_dim,)``."""
        clipped = np.minimum(np.maximum(np.ravel(action), self._action_low), self._action_high)
        scaled: ArrayLike = self._per_unit * (clipped - self._action_low) - 1.0
        return scaled


class TaskObservation(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Shows the hidden task: the flat observation, then the task, in a float32 Box ``(obs_dim + task_dim,)``.

    This is the oracle's observation, an upper bound for agents that must infer the task.

    Args:
        env: an environment with an observation that TransitionObservation takes, and a MetaTask beneath.

    Raises:
        ValueError: if the observation is none of these, no wrapper beneath has a ``task_space``, or an observation
            wrapper is around a Trial.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        check_env(env)
        check_ends_are_shown(env)
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        if not env.has_wrapper_attr("task_space"):
            raise ValueError(f"env={env} has no task_space: wrap it in MetaTask before TaskObservation.")
        seen, tasks = _vector_space(env.observation_space), env.get_wrapper_attr("task_space")
        low = np.concatenate([seen.low.ravel(), tasks.low])
        high = np.concatenate([seen.high.ravel(), tasks.high])
        self.observation_space = Box(low, high)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Reset the environment and show the new task."""
        observation, info = self.env.reset(seed=seed, options=options)
        return self._with_task(observation, info), info

    def step(self, action: Any) -> tuple[NDArray[np.float32], SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment and show the task of this episode."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        if "trial_final_observation" in info:
            final = self._with_task(info["trial_final_observation"], info)
            info = {**info, "trial_final_observation": final}
        return self._with_task(observation, info), reward, terminated, truncated, info

    def _with_task(self, observation: Any, info: dict[str, Any]) -> NDArray[np.float32]:
        return np.append(_as_vector(observation, self.env.observation_space), info["task"]).astype(np.float32)


def _vector_space(space: gym.Space[Any]) -> Box:
    """Return the float32 Box of observations that a vector network can read: the space's own shape, or flat.

    Raises:
        ValueError: if there is none, because the space holds an image, or sequences, graphs or texts of any length.
    """
    for name, part in _parts(space, "observation_space"):
        if isinstance(part, Box) and part.dtype == np.uint8 and len(part.shape) > 1:
            raise ValueError(f"{name}={part} is an image: encode it as a float vector first.")
        if isinstance(part, Dict | Tuple) and not part.spaces:
            raise ValueError(f"{name}={part} holds nothing: leave it out.")
    if not space.is_np_flattenable or flatdim(space) == 0:
        raise ValueError(f"observation_space={space} has no fixed size: make it a Box, or a Dict of Boxes.")
    box: Any = space if isinstance(space, Box) else flatten_space(space)
    with np.errstate(over="ignore"):  # float64 bounds beyond float32 become infinite, as they should
        return Box(box.low.astype(np.float32), box.high.astype(np.float32))


def _parts(space: gym.Space[Any], name: str) -> Iterator[tuple[str, gym.Space[Any]]]:
    """Yield the spaces that a space is made of, each with its name: a Dict's entry, a Tuple's place."""
    inner = space.spaces.items() if isinstance(space, Dict) else enumerate(getattr(space, "spaces", ()))
    yield name, space
    for key, part in inner:
        yield from _parts(part, f"{name}[{key!r}]")


def _as_vector(observation: Any, space: gym.Space[Any]) -> NDArray[np.float32]:
    """Return an observation as a new float32 array of ``_vector_space``'s shape."""
    return np.array(observation if isinstance(space, Box) else flatten(space, observation), dtype=np.float32)


def _bounded_actions(space: gym.Space[Any]) -> Box:
    """Return the action space with float32 bounds, if actions can be scaled from it."""
    if not isinstance(space, Box):
        raise ValueError(f"action_space={space} is no Box: make it one, only continuous actions are supported.")
    if not space.is_bounded() or not (space.low < space.high).all():
        raise ValueError(f"action_space={space} has open or empty bounds: bound every action, with low < high.")
    return Box(space.low.astype(np.float32), space.high.astype(np.float32))
