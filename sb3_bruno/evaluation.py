"""Runs a model on given tasks, episode by episode, and records every reward.

Knows SB3's ``predict`` and environments that take their hidden task by ``reset(options={"task": task})``;
knows no algorithm.
"""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.type_aliases import PolicyPredictor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.adaptation_result import AdaptationResult

__all__ = ["AdaptationResult", "evaluate_adaptation", "library_versions"]


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
) -> AdaptationResult:
    """Run whole episodes of every task, many side by side, each without a state to start from.

    Args:
        model: anything with SB3's ``predict``; its ``state`` is carried through each episode.
        make_env: makes one environment with a time limit; called up to ``max_envs`` times.
        tasks: the tasks to give at reset, ``(n_tasks, task_dim)``.
        n_episodes: per task.
        deterministic: whether the model acts without noise; if not, torch's seed decides the numbers too.
        seed: gives every episode a reset seed of its own, the same for any ``max_envs``.
        vec_normalize: the training environment's, whose statistics normalise the observations; not updated.
        max_envs: the number of environments side by side, at most.
        config: kept in the result, to tell it from others.

    Returns:
        The raw rewards; an episode that ends early is padded with NaN.

    Raises:
        ValueError: if an argument is invalid, or the environment does not take the task that it is given.
    """
    task_array = np.asarray(tasks, dtype=np.float32)
    if task_array.ndim != 2 or task_array.size == 0:
        raise ValueError(f"tasks have shape {task_array.shape}: give at least one, as an array (n_tasks, task_dim).")
    for name, value in (("n_episodes", n_episodes), ("max_envs", max_envs)):
        if value < 1:
            raise ValueError(f"{name}={value} is not positive: give at least 1.")
    jobs = np.repeat(task_array, n_episodes, axis=0)  # tasks a, b and 2 episodes: a a b b
    first_seed = int(np.random.SeedSequence(seed).generate_state(1)[0])
    size = min(max_envs, len(jobs))
    venv = DummyVecEnv([make_env] * size)
    episodes: list[NDArray[np.float32]] = []
    try:
        for start in range(0, len(jobs), size):
            venv.seed(first_seed + start)  # the i-th environment's is i more
            episodes += _run_episodes(model, venv, jobs[start : start + size], vec_normalize, deterministic)
    finally:
        venv.close()
    rewards = np.full((len(jobs), max(map(len, episodes))), np.nan, dtype=np.float32)
    for row, episode in zip(rewards, episodes, strict=True):
        row[: len(episode)] = episode
    return AdaptationResult(
        tasks=np.asarray(tasks, dtype=np.float64),
        rewards=rewards.reshape(len(task_array), n_episodes, -1),
        config=dict(config or {}),
        seed=seed,
        versions=library_versions(),
    )


def library_versions() -> dict[str, str]:
    """The versions that a result depends on, and this package's git commit when it runs from a clone."""
    versions = {"python": platform.python_version()}
    for name in (
        "sb3_bruno",
        "stable_baselines3",
        "sb3_contrib",
        "torch",
        "zuko",
        "numpy",
        "gymnasium",
        "mujoco",
    ):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # run from the source tree
            continue
    commit = _git_commit(Path(__file__))
    return versions | ({"commit": commit} if commit else {})


def _run_episodes(
    model: PolicyPredictor,
    venv: DummyVecEnv,
    tasks: NDArray[np.float32],
    vec_normalize: VecNormalize | None,
    deterministic: bool,
) -> list[NDArray[np.float32]]:
    """The rewards of one episode of each task, ``(n, task_dim)``; spare environments idle along."""
    n = len(tasks)
    options = [{"task": task} for task in tasks]
    venv.set_options(options + options[-1:] * (venv.num_envs - n))
    observations = venv.reset()
    for task, info in zip(tasks, venv.reset_infos, strict=False):
        _check_task(task, info)
    state, episode_start = None, np.ones(venv.num_envs, dtype=bool)
    running = np.ones(n, dtype=bool)
    rewards: list[NDArray[np.float32]] = []
    while running.any():
        assert isinstance(observations, np.ndarray | dict)
        if vec_normalize is not None:
            observations = vec_normalize.normalize_obs(observations)
        actions, state = model.predict(observations, state, episode_start, deterministic)
        observations, reward, episode_start, _ = venv.step(actions)
        if not np.isfinite(reward[:n][running]).all():
            raise ValueError(f"the environment's reward at step {len(rewards)} is not finite: check its reward.")
        rewards.append(np.where(running, reward[:n], np.float32(np.nan)))
        running &= ~episode_start[:n]
    return [row[~np.isnan(row)] for row in np.stack(rewards, axis=1)]


def _check_task(task: NDArray[np.float32], info: Mapping[str, Any]) -> None:
    """Raise unless the reset's ``info`` names the task that was given."""
    named = info.get("task")
    if named is None or np.shape(named) != task.shape or not np.allclose(named, task):
        raise ValueError(
            f"the environment was given task {task} and names {named} in info['task']: "
            "let make_env return one that takes reset(options={'task': ...}), as MetaTask does."
        )


def _git_commit(file: Path) -> str | None:
    """The commit of the clone that tracks ``file``, with ``-dirty`` if changed since; None without one."""
    git = ["git", "-C", str(file.parent)]
    try:
        subprocess.run([*git, "ls-files", "--error-unmatch", file.name], check=True, capture_output=True)
        describe = [*git, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
        return subprocess.run(describe, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
