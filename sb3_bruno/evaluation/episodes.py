"""Plays a model on given tasks, in many environments side by side, and returns whole episodes.

Knows SB3's ``predict``, and environments that take their hidden task by ``reset(options={"task": task})``. Knows no
algorithm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.type_aliases import PolicyPredictor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.evaluation.progress import progress
from sb3_bruno.evaluation.told import success, task_name


class Episode(NamedTuple):
    """One episode in the environment's own units.

    Of a Dict observation, the entry ``"observation"`` is kept; without that entry the observations have width 0.

    Attributes:
        observations: what the environment showed before each action, ``(length, ...)``.
        actions: what the environment was given, ``(length, ...)``.
        rewards: ``(length,)``, in single precision, as SB3's VecEnv delivers them.
        next_observations: what each action led to, the terminal observation last, ``(length, ...)``.
        inner_ends: whether an episode within a trial ended with this transition, ``(length,)``. The model never sees
            such a transition: the next observation that it is shown is the first of the next inner episode.
        task_name: what the environment calls the task in the reset's ``info["task_name"]``; ``""`` for nothing.
        success: ``info["is_success"]`` at the last step, in [0, 1]; NaN if the environment does not tell.
    """

    observations: NDArray[Any]
    actions: NDArray[Any]
    rewards: NDArray[np.float32]
    next_observations: NDArray[Any]
    inner_ends: NDArray[np.bool_]
    task_name: str = ""
    success: float = np.nan


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
    progress_bar: bool = False,
) -> list[list[Episode]]:
    """Play ``n_episodes`` whole episodes of every task, each without a state to start from.

    The arguments are those of ``evaluate_adaptation``.

    Returns:
        The episodes of each task, in the order of the tasks.

    Raises:
        ValueError: if an argument is invalid, a reward is not finite, a success is none, or the environment ignores
            the task given to it.
    """
    if not callable(make_env):
        raise ValueError(f"make_env={make_env!r} is no function: give one without arguments that makes an environment.")
    try:
        given = np.asarray(tasks)
        task_array = given.astype(np.float32)
    except (TypeError, ValueError) as error:
        raise ValueError(f"tasks={tasks!r} are no numbers: give an array (n_tasks, task_dim).") from error
    if task_array.ndim != 2 or task_array.size == 0:
        raise ValueError(f"tasks have shape {task_array.shape}: give at least one, as an array (n_tasks, task_dim).")
    for row in np.flatnonzero((task_array != given).any(axis=1)) if given.dtype.kind in "iu" else ():
        raise ValueError(
            f"tasks[{row}]={given[row].tolist()} becomes {task_array[row].tolist()} in float32: give whole numbers "
            "that it holds, such as all up to 2^24."
        )
    for name, value in (("n_episodes", n_episodes), ("max_envs", max_envs)):
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1:
            raise ValueError(f"{name}={value!r} is not positive and whole: give at least 1.")
    jobs = np.repeat(task_array, n_episodes, axis=0)  # tasks a, b and 2 episodes: a a b b
    first_seed = int(np.random.SeedSequence(seed).generate_state(1)[0])
    size = min(max_envs, len(jobs))
    venv = DummyVecEnv([make_env] * size)
    episodes: list[Episode] = []
    bar = progress(shown=progress_bar, total=len(jobs), about="episodes")
    try:
        for start in range(0, len(jobs), size):
            venv.seed(first_seed + start)  # environment i gets this plus i, so each job has its own seed
            episodes += _play_batch(model, venv, jobs[start : start + size], vec_normalize, deterministic, bar)
    finally:
        bar.close()
        venv.close()
    return [episodes[start : start + n_episodes] for start in range(0, len(jobs), n_episodes)]


def pad_episodes(rows: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Stack arrays ``(length, ...)`` of different lengths into one, ``(n, longest, ...)``, padded with NaN."""
    padded = np.full((len(rows), max(map(len, rows)), *rows[0].shape[1:]), np.nan, dtype=rows[0].dtype)
    for row, values in zip(padded, rows, strict=True):
        row[: len(values)] = values
    return padded


def _play_batch(
    model: PolicyPredictor,
    venv: DummyVecEnv,
    tasks: NDArray[np.float32],
    vec_normalize: VecNormalize | None,
    deterministic: bool,
    bar: Any,
) -> list[Episode]:
    """Play one episode of each task, ``(n, task_dim)``; environments beyond the n-th run along and are ignored."""
    n = len(tasks)
    options = [{"task": task} for task in tasks]
    venv.set_options(options + options[-1:] * (venv.num_envs - n))
    observations = venv.reset()
    for task, info in zip(tasks, venv.reset_infos, strict=False):
        _check_task(task, info)
    state, episode_start = None, np.ones(venv.num_envs, dtype=bool)
    names = [task_name(info) for info in venv.reset_infos[:n]]
    running, lengths, successes = np.ones(n, dtype=bool), np.zeros(n, dtype=np.int64), np.full(n, np.nan)
    steps: list[tuple[NDArray[Any], ...]] = []
    while running.any():
        before = _own_part(observations, (venv.num_envs,))
        assert isinstance(observations, np.ndarray | dict)
        if vec_normalize is not None:
            observations = vec_normalize.normalize_obs(observations)
        actions, state = model.predict(observations, state, episode_start, deterministic)
        observations, rewards, episode_start, infos = venv.step(actions)
        if not np.isfinite(rewards[:n][running]).all():
            raise ValueError(f"the reward at step {len(steps)} is not finite: let make_env's environment pay a number.")
        after = _with_final_observations(_own_part(observations, (venv.num_envs,)), infos)
        inner_ends = np.array(["trial_final_observation" in info for info in infos])
        steps.append((before, actions, rewards, after, inner_ends))
        lengths += running
        for i in np.flatnonzero(running & episode_start[:n]):
            successes[i] = success(infos[i])
        bar.update(int((running & episode_start[:n]).sum()))
        bar.set_postfix(step=len(steps), refresh=False)
        running &= ~episode_start[:n]
    columns = [np.stack(column, axis=1) for column in zip(*steps, strict=True)]  # (num_envs, longest, ...) each
    told = enumerate(zip(lengths, names, successes.tolist(), strict=True))
    return [
        Episode._make([*(column[i, :length] for column in columns), name, success])
        for i, (length, name, success) in told
    ]


def _own_part(observations: Any, batch_shape: tuple[int, ...] = ()) -> NDArray[Any]:
    """Return the entry ``"observation"`` of a Dict, of width 0 if there is none; anything but a Dict as it is."""
    if not isinstance(observations, Mapping):
        return np.asarray(observations)
    return np.asarray(observations.get("observation", np.empty((*batch_shape, 0))))


def _with_final_observations(observations: NDArray[Any], infos: Sequence[Mapping[str, Any]]) -> NDArray[Any]:
    """Replace each observation that begins an episode by the last of the episode before, which ``infos`` holds."""
    replaced = observations.copy()
    for observation, info in zip(replaced, infos, strict=True):
        for key in ("terminal_observation", "trial_final_observation"):  # SB3's name, and a trial's
            if key not in info:
                continue
            final = _own_part(info[key])
            if final.shape != observation.shape:
                raise ValueError(
                    f"make_env's environment shows observations of shape {observation.shape}, and where an episode "
                    f"ends info[{key!r}] has shape {final.shape}: put wrappers of observations inside the Trial."
                )
            observation[...] = final
    return replaced


def _check_task(task: NDArray[np.float32], info: Mapping[str, Any]) -> None:
    """Raise a ValueError unless the reset's ``info`` names the task that was given."""
    named = info.get("task")
    if named is None or np.shape(named) != task.shape or not np.allclose(named, task):
        raise ValueError(
            f"make_env's environment was given task {task} and names {named} in info['task']: "
            "make one that takes reset(options={'task': ...}), as MetaTask does."
        )
