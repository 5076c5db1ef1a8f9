"""Measures the rewards that a model earns on given tasks, and keeps with them how they were made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike
from stable_baselines3.common.type_aliases import PolicyPredictor
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.episodes import pad_episodes, play_episodes
from sb3_bruno.evaluation.versions import library_versions


def evaluate_adaptation(
    model: PolicyPredictor,
    make_env: Callable[[], gym.Env[Any, Any]],
    tasks: ArrayLike,
    *,
    n_episodes: int = 10,
    deterministic: bool = True,
    seed: int = 0,
    vec_normalize: VecNormalize | None = None,
    max_envs: int = 64,
    config: Mapping[str, Any] | None = None,
    progress_bar: bool = False,
) -> AdaptationResult:
    """Play whole episodes of every task, many side by side; each starts without a state, so without a belief.

    Args:
        model: anything with SB3's ``predict``; its ``state`` is carried through each episode.
        make_env: makes one environment with a time limit; called up to ``max_envs`` times.
        tasks: the tasks to give at reset, ``(n_tasks, task_dim)``.
        n_episodes: episodes of each task.
        deterministic: whether the model acts without noise. If it does not, or if its encoder samples, torch's seed
            decides the numbers too.
        seed: gives every episode its own reset seed, the same for any ``max_envs``.
        vec_normalize: the VecNormalize of training. Its statistics normalise the observations and stay as they are.
        max_envs: the most environments to step side by side.
        config: settings to keep in the result, so that it can be told from others.
        progress_bar: show one, where stderr is a terminal.

    Returns:
        The environment's own rewards; an episode that ends early is padded with NaN. With them, the environment's
        names of the tasks (``info["task_name"]``), and which episodes ended in success (``info["is_success"]``).

    Raises:
        ValueError: if an argument is invalid, a reward is not finite, a success is none, or the environment ignores
            the task given to it.
    """
    episodes = play_episodes(
        model,
        make_env,
        tasks,
        n_episodes=n_episodes,
        deterministic=deterministic,
        seed=seed,
        vec_normalize=vec_normalize,
        max_envs=max_envs,
        progress_bar=progress_bar,
    )
    played = [episode for of_task in episodes for episode in of_task]
    rewards = pad_episodes([episode.rewards for episode in played])
    names = [of_task[0].task_name for of_task in episodes]
    successes = np.array([episode.success for episode in played]).reshape(-1, n_episodes)
    return AdaptationResult(
        tasks=np.asarray(tasks, dtype=np.float64),
        rewards=rewards.reshape(len(episodes), n_episodes, -1),
        config=dict(config or {}),
        seed=seed,
        versions=library_versions(),
        names=names if any(names) else None,
        successes=None if np.isnan(successes).all() else successes,
    )
