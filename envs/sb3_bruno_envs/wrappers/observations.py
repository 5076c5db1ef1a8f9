"""Shows the last transition to an agent that infers the task, or the task to an oracle; knows no environment."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray


class TransitionObservation(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Shows the last transition, so that an agent which receives observations alone can infer the task.

    The observation becomes a Dict of float32 Boxes:

    - ``observation``: the environment's own, of the same shape;
    - ``action``: the last action, flat, ``(action_dim,)``, clipped and scaled from its bounds to [-1, 1];
    - ``reward``: the last reward, ``(1,)``;
    - ``episode_start``: ``(1,)``, 1 after a reset and 0 after a step, unless that step began a trial's next
      episode: then 0.5, because it is not the last action that led to ``observation``, but the task is the same.

    After a reset, ``action`` and ``reward`` are zeros.

    Args:
        env: an environment with a Box observation and a bounded Box action.

    Raises:
        ValueError: if the observation is no Box or a uint8 image, or the action no Box or not bounded.

    Example:
        >>> env = TransitionObservation(gym.make("Pendulum-v1"))
        >>> list(env.observation_space)
        ['action', 'episode_start', 'observation', 'reward']
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        actions = _bounded_actions(env.action_space)
        self._action_low = actions.low.ravel()  # (action_dim,)
        self._action_high = actions.high.ravel()  # (action_dim,)
        self._per_unit = 2.0 / (self._action_high - self._action_low)  # (action_dim,)
        self.observation_space = Dict(
            {
                "action": Box(-1.0, 1.0, self._action_low.shape),
                "episode_start": Box(0.0, 1.0, (1,)),
                "observation": _float32_box(env.observation_space),
                "reward": Box(-np.inf, np.inf, (1,)),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        """Reset the environment; there is no last action or reward yet."""
        observation, info = self.env.reset(seed=seed, options=options)
        no_action = np.zeros_like(self._action_low)
        return _transition(observation, no_action, 0.0, episode_start=1.0), info

    def step(self, action: Any) -> tuple[dict[str, NDArray[np.float32]], SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment and show the action and the reward of this step."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        begins = 0.5 if "trial_final_observation" in info else 0.0  # Trial marks an inner start so
        seen = _transition(observation, self._scale(action), float(reward), episode_start=begins)
        return seen, reward, terminated, truncated, info

    def _scale(self, action: ArrayLike) -> ArrayLike:
        """Clip ``action`` into its bounds and map it linearly onto [-1, 1], flat, ``(action_dim,)``."""
        clipped = np.minimum(np.maximum(np.ravel(action), self._action_low), self._action_high)
        scaled: ArrayLike = self._per_unit * (clipped - self._action_low) - 1.0
        return scaled


class TaskObservation(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Shows the hidden task: the flat observation, then the task, in a float32 Box ``(obs_dim + task_dim,)``.

    This is the oracle's observation, an upper bound for agents that must infer the task.

    Args:
        env: an environment with a Box observation and a MetaTask beneath.

    Raises:
        ValueError: if the observation is no Box or a uint8 image, or no wrapper beneath has a ``task_space``.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        if not env.has_wrapper_attr("task_space"):
            raise ValueError(f"env={env} has no task_space: wrap it in MetaTask before TaskObservation.")
        seen, tasks = _float32_box(env.observation_space), env.get_wrapper_attr("task_space")
        low = np.concatenate([seen.low.ravel(), tasks.low])
        high = np.concatenate([seen.high.ravel(), tasks.high])
        self.observation_space = Box(low, high)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Reset the environment and show the new task."""
        observation, info = self.env.reset(seed=seed, options=options)
        return _with_task(observation, info), info

    def step(self, action: Any) -> tuple[NDArray[np.float32], SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment and show the task of this episode."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return _with_task(observation, info), reward, terminated, truncated, info


def _transition(
    observation: ArrayLike, action: ArrayLike, reward: float, episode_start: float
) -> dict[str, NDArray[np.float32]]:
    """Return the four entries as new float32 arrays."""
    return {
        "action": np.array(action, dtype=np.float32),
        "episode_start": np.array([episode_start], dtype=np.float32),
        "observation": np.array(observation, dtype=np.float32),
        "reward": np.array([reward], dtype=np.float32),
    }


def _with_task(observation: ArrayLike, info: dict[str, Any]) -> NDArray[np.float32]:
    return np.concatenate([np.ravel(observation), info["task"]]).astype(np.float32)


def _float32_box(space: gym.Space[Any]) -> Box:
    """Return the observation space with float32 bounds, if a vector network can read it."""
    if not isinstance(space, Box):
        raise ValueError(f"observation_space={space} is no Box: make it one, for example with FlattenObservation.")
    if space.dtype == np.uint8 and len(space.shape) > 1:
        raise ValueError(f"observation_space={space} is an image: encode it as a float vector first.")
    with np.errstate(over="ignore"):  # float64 bounds beyond float32 become infinite, as they should
        return Box(space.low.astype(np.float32), space.high.astype(np.float32))


def _bounded_actions(space: gym.Space[Any]) -> Box:
    """Return the action space with float32 bounds, if actions can be scaled from it."""
    if not isinstance(space, Box):
        raise ValueError(f"action_space={space} is no Box: make it one, only continuous actions are supported.")
    if not space.is_bounded() or not (space.low < space.high).all():
        raise ValueError(f"action_space={space} has open or empty bounds: bound every action, with low < high.")
    return Box(space.low.astype(np.float32), space.high.astype(np.float32))
