"""Guards learning against envs that misbehave between two of its steps."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from sb3_bruno.algorithms.reading import read_numbers
from sb3_bruno.buffers import TaskReplayBuffer


def has_moved(env: VecEnv, n_steps: NDArray[np.int64] | None) -> bool:
    """Tell whether an env is at another step than the agent's last, and warn if so.

    Where envs do not count their steps, as ``TransitionObservation`` does, nothing can be told.

    Args:
        env: the envs.
        n_steps: how many steps the agent has taken in the running episodes, (n_envs,). None: nobody knows.
    """
    if n_steps is None or not env.has_attr("episode_steps") or env.get_attr("episode_steps") == n_steps.tolist():
        return False
    warnings.warn(
        "Since the agent last learned, someone else has stepped or reset its env, such as an evaluation: learning goes "
        "on with new episodes. Evaluate on an env of its own.",
        stacklevel=4,
    )
    return True


def warn_of_empty_episodes(n_episodes: int) -> None:
    """Warn that there was nothing to infer a task from."""
    warnings.warn(
        f"{n_episodes} episodes have ended, and none held a transition to infer the task from, for each ends after one "
        "step: let (inner) episodes be longer.",
        stacklevel=3,
    )


def check_step_tasks(infos: Sequence[dict[str, Any]], buffer: TaskReplayBuffer, task_space: spaces.Box) -> None:
    """Check the tasks in the infos of a step, before it is stored; one that is missing is the buffer's to refuse.

    Raises:
        ValueError: if a task is no vector of the task space, or another than that of the step before in its episode.
    """
    if not all("task" in info for info in infos):
        return
    tasks = [read_numbers(f"info['task'] of env {i}", info["task"]).ravel() for i, info in enumerate(infos)]
    for i, task in enumerate(tasks):
        if task.shape != task_space.shape:
            raise ValueError(
                f"The task of env {i} is {task}, and the `task_space` has {task_space.shape[0]} numbers: give as many."
            )
    is_running = buffer.episodes.lengths > 0
    if not is_running.any():
        return
    before = buffer.last_tasks()
    has_changed = is_running & (np.abs(np.stack(tasks) - before) > 0).any(axis=1)
    for i in np.flatnonzero(has_changed).tolist():
        raise ValueError(
            f"The task of env {i} changed from {before[i]} to {tasks[i]} within an episode, which has one: "
            "end the episode there."
        )


@contextmanager
def finite_statistics(env: VecNormalize | None) -> Iterator[None]:
    """Take the statistics of a VecNormalize back, if the block fails and leaves one that is not finite.

    It reads a number before the agent can refuse it.
    """
    kept = [(moments, (moments.mean, moments.var, moments.count)) for moments in _moments(env)]
    try:
        yield
    except BaseException:
        if not all(np.isfinite([moments.mean, moments.var]).all() for moments, _ in kept):
            for moments, before in kept:
                moments.mean, moments.var, moments.count = before
        raise


def _moments(env: VecNormalize | None) -> list[RunningMeanStd]:
    """List the running statistics of a VecNormalize, none if there is none."""
    if env is None:
        return []
    of_observations: Any = getattr(env, "obs_rms", None) or {}
    several = of_observations.values() if isinstance(of_observations, dict) else [of_observations]
    return [*several, env.ret_rms]
