"""Joins several episodes of a task into a trial; knows no task and no observation format."""

from __future__ import annotations

import copy
from typing import Any, SupportsFloat

import gymnasium as gym
from gymnasium.utils import RecordConstructorArgs

from sb3_bruno_envs.arguments import check_count, check_env


class Trial(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Joins ``n_episodes`` inner episodes into an episode, the trial, so that each can use what earlier ones learned.

    When an inner episode ends, terminated or truncated, and is not the last, the environment is reset at once and
    without a seed. The step returns the first observation of the next inner episode and neither flag, and
    ``info["trial_final_observation"]`` holds a copy of the observation at which the ended episode stopped. The trial
    ends as its last inner episode ends. ``info["episode_index"]``, in 0 .. ``n_episodes - 1``, names the inner episode
    that a reset began or that a step belongs to; the last step of an inner episode still belongs to it.

    Wrap MetaTask around the trial, so that all inner episodes share a task, and put the time limit of an inner episode
    inside. Observation wrappers belong inside, too: around the trial they would not see where an inner episode ended.

    Args:
        env: an environment whose episodes end.
        n_episodes: the number of inner episodes.

    Raises:
        ValueError: if ``n_episodes`` is not a positive integer, or there is a MetaTask inside.

    Example:
        >>> pendulum = gym.make("Pendulum-v1", max_episode_steps=50)
        >>> env = TransitionObservation(MetaTask(Trial(pendulum, n_episodes=3)))
    """

    def __init__(self, env: gym.Env[Any, Any], n_episodes: int) -> None:
        check_env(env)
        check_count("n_episodes", n_episodes)  # a trial of 2.5 would never end
        if env.has_wrapper_attr("task_space"):
            raise ValueError(f"env={env} would draw a task per inner episode: wrap Trial in MetaTask instead.")
        RecordConstructorArgs.__init__(self, n_episodes=n_episodes)
        super().__init__(env)
        self.n_episodes = n_episodes
        self._episode_index = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin a trial; seed and options are for its first inner episode."""
        self._episode_index = 0
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, {**info, "episode_index": 0}

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment, and begin the next inner episode where one ends."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        info = {**info, "episode_index": self._episode_index}
        if not (terminated or truncated) or self._episode_index == self.n_episodes - 1:
            return observation, reward, terminated, truncated, info
        info["trial_final_observation"] = copy.deepcopy(observation)
        self._episode_index += 1
        observation, _ = self.env.reset()
        return observation, reward, False, False, info


def check_ends_are_shown(env: gym.Env[Any, Any]) -> None:
    """Check that no observation wrapper is around a trial, whose inner ends it would leave as they were.

    Raises:
        ValueError: naming the wrapper.
    """
    around = None
    while isinstance(env, gym.Wrapper):
        if isinstance(env, Trial) and around is not None:
            raise ValueError(f"{around} around a Trial does not see where inner episodes end: put it inside the Trial.")
        around = type(env).__name__ if isinstance(env, gym.ObservationWrapper) else around
        env = env.env
