"""Runs a model on given tasks, many environments side by side, and records whole episodes.

Knows SB3's ``predict`` and environments that take their hidden task by ``reset(options={"task": task})``;
knows no algorithm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.type_aliases import PolicyPredictor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize


class Episode(NamedTuple):
    """One episode in the environment's own units; of Dict observations the entry ``"observation"``, if any.

    Attributes:
        observations: where the model acted, ``(length, ...)``.
        actions: as the environment took them, ``(length, ...)``.
        rewards: single precision, as SB3's VecEnv delivers them, ``(length,)``.
        next_observations: where the actions led, the terminal observation last, ``(length, ...)``.
        inner_ends: whether an episode within a trial ended there, ``(length,)``: the next observation that the model
            was shown is another one's first, and of this transition it was shown nothing.
    """

    observations: NDArray[Any]
    actions: NDArray[Any]
    rewards: NDArray[np.float32]
    next_observations: NDArray[Any]
    inner_ends: NDArray[np.bool_]


def play_episodes(
    model: PolicyPredictor,
    make_env: Callable[[], gym.Env[Any, Any]],
    tasks: ArrayLike,
    *,
    n_episodes: int,
    deterministic: bool = True,
    seed: int = 0,
    vec_normalize: VecNormalize | None = None,
    max_envs: int = 64,
) -> list[list[Episode]]:
    """Run ``n_episodes`` whole episodes of every task, each without a state to start from.

    The arguments are those of ``evaluate_adaptation``.

    Returns:
        The episodes of each task, in the order of the tasks.

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
    episodes: list[Episode] = []
    try:
        for start in range(0, len(jobs), size):
            venv.seed(first_seed + start)  # the i-th environment's is i more
            episodes += _run_episodes(model, venv, jobs[start : start + size], vec_normalize, deterministic)
    finally:
        venv.close()
    return [episodes[start : start + n_episodes] for start in range(0, len(jobs), n_episodes)]


def pad_episodes(rows: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Arrays ``(length, ...)`` of any lengths as one, ``(n, longest, ...)``, NaN after each one's end."""
    padded = np.full((len(rows), max(map(len, rows)), *rows[0].shape[1:]), np.nan, dtype=rows[0].dtype)
    for row, values in zip(padded, rows, strict=True):
        row[: len(values)] = values
    return padded


def _run_episodes(
    model: PolicyPredictor,
    venv: DummyVecEnv,
    tasks: NDArray[np.float32],
    vec_normalize: VecNormalize | None,
    deterministic: bool,
) -> list[Episode]:
    """One episode of each task, ``(n, task_dim)``; spare environments idle along."""
    n = len(tasks)
    options = [{"task": task} for task in tasks]
    venv.set_options(options + options[-1:] * (venv.num_envs - n))
    observations = venv.reset()
    for task, info in zip(tasks, venv.reset_infos, strict=False):
        _check_task(task, info)
    state, episode_start = None, np.ones(venv.num_envs, dtype=bool)
    running, lengths = np.ones(n, dtype=bool), np.zeros(n, dtype=np.int64)
    steps: list[tuple[NDArray[Any], ...]] = []
    while running.any():
        here = _own(observations, (venv.num_envs,))
        assert isinstance(observations, np.ndarray | dict)
        if vec_normalize is not None:
            observations = vec_normalize.normalize_obs(observations)
        actions, state = model.predict(observations, state, episode_start, deterministic)
        observations, rewards, episode_start, infos = venv.step(actions)
        if not np.isfinite(rewards[:n][running]).all():
            raise ValueError(f"the environment's reward at step {len(steps)} is not finite: check its reward.")
        inner_ends = np.array(["final_observation" in info for info in infos])
        steps.append((here, actions, rewards, _arrivals(_own(observations, (venv.num_envs,)), infos), inner_ends))
        lengths += running
        running &= ~episode_start[:n]
    columns = [np.stack(column, axis=1) for column in zip(*steps, strict=True)]  # (num_envs, longest, ...) each
    return [Episode(*(column[i, :length] for column in columns)) for i, length in enumerate(lengths)]


def _own(observations: Any, batch_shape: tuple[int, ...] = ()) -> NDArray[Any]:
    """The environment's own observation: of a Dict the entry of that name, of width 0 if there is none."""
    if not isinstance(observations, Mapping):
        return np.asarray(observations)
    return np.asarray(observations.get("observation", np.empty((*batch_shape, 0))))


def _arrivals(observations: NDArray[Any], infos: Sequence[Mapping[str, Any]]) -> NDArray[Any]:
    """Where the last actions led: ``observations``, unless an episode, or one within a trial, ended there."""
    arrivals = observations.copy()
    for arrival, info in zip(arrivals, infos, strict=True):
        for key in ("terminal_observation", "final_observation"):  # SB3's name, and a trial's
            if key in info:
                arrival[...] = _own(info[key])
    return arrivals


def _check_task(task: NDArray[np.float32], info: Mapping[str, Any]) -> None:
    """Raise unless the reset's ``info`` names the task that was given."""
    named = info.get("task")
    if named is None or np.shape(named) != task.shape or not np.allclose(named, task):
        raise ValueError(
            f"the environment was given task {task} and names {named} in info['task']: "
            "let make_env return one that takes reset(options={'task': ...}), as MetaTask does."
        )
