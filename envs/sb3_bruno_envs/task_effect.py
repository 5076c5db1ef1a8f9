"""Says whether tasks have an effect, and the same effect each time; knows no algorithm.

A function that applies tasks may do nothing, and nobody would see it: ``info`` names the task all the same.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

Env: TypeAlias = gym.Env[Any, Any]
Episode: TypeAlias = list[NDArray[np.float64]]  # the first observation; then observation, reward and end of each step

_N_TASKS = 5
_DRAWS = 8
_SHORT, _LONG = 20, 200  # steps
_HOLDS = (10, 10, 30, 30, 30)  # steps in a row with the same action, in long episodes: that leads further
_ROUNDING = 1e-4  # relative; may have grown over a short episode


def find_task_without_effect(env: Env, *, seconds: float = np.inf) -> str | None:
    """Play episodes of the same seed and the same actions under several tasks, far apart.

    Some of them must differ, in an observation, a reward or an end, and a task must have the same episode again after
    others. Where short episodes are alike, long ones decide.

    Args:
        env: an environment with ``task_space`` and with tasks in its infos, which is left in another episode.
        seconds: the time that this may take.

    Returns:
        What is wrong, with the remedy; None if nothing is, or there are no two tasks to compare.

    Raises:
        TimeoutError: if it takes longer.
    """
    space = env.get_wrapper_attr("task_space")
    if np.array_equal(space.low, space.high):
        return None
    deadline = time.perf_counter() + seconds
    actions = _actions(env, _SHORT, 0)
    with _frozen_statistics(env):
        task = env.reset(seed=0)[1]["task"]
        first, again = _play(env, [task, task], 0, actions, deadline)
        if not _alike(first, again, _ROUNDING):
            return _comes_differently(task)
        tasks = _distant_tasks(env)
        if len(tasks) < 2 or not _obeys(env, tasks[-1]):
            return None
        first, *others, last = _play(env, [*tasks, tasks[0]], 0, actions, deadline)
        if not _alike(first, last, _ROUNDING):
            return _comes_differently(tasks[0])
        if _any_effect(first, others):
            return None
        for seed, actions in _long_plans(env):
            first, *others = _play(env, tasks, seed, actions, deadline)
            if _any_effect(first, others):
                return None
    return (
        f"{len(tasks)} tasks, from {tasks[0]} to {tasks[1]}, made no difference to {len(_HOLDS)} episodes of up "
        f"to {_LONG} steps: let apply_task write, for every task, what the environment reads. If the environment's own "
        "reset writes that too, use MetaTask(when='after_reset'); if a wrapper keeps it, MetaTask(unwrap=False)."
    )


def find_entries_without_effect(env: Env) -> Iterator[int]:
    """Change one entry of the task at a time; yield those that make no difference, if the task has several.

    Args:
        env: an environment with tasks in which ``find_task_without_effect`` finds nothing.
    """
    plans = [(0, _actions(env, _SHORT, 0)), *_long_plans(env)]
    with _frozen_statistics(env):
        tasks = np.stack(_distant_tasks(env))  # (n, dim)
        if tasks.shape[1] == 1 or not _obeys(env, tasks[-1]):
            return
        for i in np.flatnonzero(np.ptp(tasks, axis=0)).tolist():
            pairs = [_changed(tasks, task, i) for task in tasks]
            if not any(_has_effect(env, pair, *plan) for plan in plans for pair in pairs):
                yield i


def _changed(tasks: NDArray[Any], task: NDArray[Any], i: int) -> list[NDArray[Any]]:
    """Return a task, and the same but for entry ``i``, which is that of the task where it is furthest."""
    other = task.copy()
    other[i] = tasks[np.abs(tasks[:, i] - task[i]).argmax(), i]
    return [task, other]


def _has_effect(env: Env, pair: list[NDArray[Any]], seed: int, actions: list[Any]) -> bool:
    try:
        first, other = _play(env, pair, seed, actions, np.inf)
    except Exception:  # entries of two tasks need not make a third: [1, 1] is no one-hot
        return True
    return _any_effect(first, [other])


def _comes_differently(task: NDArray[Any]) -> str:
    return (
        f"the task {task} gave another episode when it came again, with the same seed and actions: let apply_task "
        "write all that the task means, never a change relative to the last task, and draw numbers from "
        "self.np_random alone."
    )


def _distant_tasks(env: Env) -> list[NDArray[Any]]:
    """Return up to ``_N_TASKS`` different tasks that resets give, each far from those before it."""
    seeds = [*range(_DRAWS), *[None] * _DRAWS]  # without a seed a cycle goes on
    tasks = [env.reset(seed=seed)[1]["task"] for seed in seeds]
    drawn = np.unique(np.stack(tasks), axis=0)  # (n, dim)
    scaled = drawn / np.maximum(np.ptp(drawn, axis=0), 1e-12)
    chosen = [0]
    while len(chosen) < min(_N_TASKS, len(drawn)):
        gaps = np.linalg.norm(scaled[:, None] - scaled[chosen], axis=-1).min(axis=1)  # to the nearest chosen
        chosen.append(int(gaps.argmax()))
    return [drawn[i] for i in chosen]


def _obeys(env: Env, task: NDArray[Any]) -> bool:
    """Return whether the environment takes a task from the options."""
    return np.array_equal(env.reset(seed=0, options={"task": task})[1]["task"], task)


def _actions(env: Env, n: int, seed: int) -> list[Any]:
    """Return ``n`` random actions; the generator of the environment's action space stays."""
    space = copy.deepcopy(env.action_space)
    space.seed(seed)
    return [space.sample() for _ in range(n)]


def _held_actions(env: Env, n: int, seed: int, hold: int) -> list[Any]:
    """Return ``n`` actions, each ``hold`` times in a row; the space's extremes, but for seed 1."""
    actions = _actions(env, -(-n // hold), seed)
    space = env.action_space
    if seed > 1 and isinstance(space, Box) and space.is_bounded():
        actions = [np.where(action > (space.low + space.high) / 2, space.high, space.low) for action in actions]
    return [action for action in actions for _ in range(hold)][:n]


def _long_plans(env: Env) -> list[tuple[int, list[Any]]]:
    """Return seeds of long episodes and their actions."""
    return [(seed, _held_actions(env, _LONG, seed, hold)) for seed, hold in enumerate(_HOLDS, start=1)]


def _play(env: Env, tasks: list[NDArray[Any]], seed: int, actions: list[Any], deadline: float) -> list[Episode]:
    """Play an episode of each task in turn, all with the same seed and actions."""
    episodes = []
    for task in tasks:
        observation, _ = env.reset(seed=seed, options={"task": task})
        episode = [_flat(observation)]
        for action in actions:
            if time.perf_counter() > deadline:
                raise TimeoutError(f"{env} is too slow to compare its tasks in time.")
            observation, reward, terminated, truncated, _ = env.step(action)
            episode.append(np.append(_flat(observation), [float(reward), terminated, truncated]))
            if terminated or truncated:
                break
        episodes.append(episode)
    return episodes


def _flat(observation: Any) -> NDArray[np.float64]:
    parts = [observation[key] for key in sorted(observation)] if isinstance(observation, dict) else [observation]
    return np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in parts])


def _alike(episode: Episode, other: Episode, tolerance: float) -> bool:
    """Return whether two episodes are of one length, and their numbers equal but for a relative ``tolerance``."""
    if [part.shape for part in episode] != [part.shape for part in other]:
        return False
    numbers, others = np.concatenate(episode), np.concatenate(other)
    return np.allclose(numbers, others, rtol=tolerance, atol=tolerance, equal_nan=True)


def _any_effect(first: Episode, others: list[Episode]) -> bool:
    """Return whether another episode differs from the first, or numbers that are not finite would hide it."""
    finite = bool(np.isfinite(np.concatenate(first)).all())
    return not finite or not all(_alike(first, other, 0.0) for other in others)


@contextmanager
def _frozen_statistics(env: Env) -> Iterator[None]:
    """Stop Gymnasium's normalising wrappers from learning: an episode would depend on those before it."""
    learning = []
    layer: Any = env
    while isinstance(layer, gym.Wrapper):
        if getattr(layer, "update_running_mean", False):
            learning.append(layer)
        layer = layer.env
    for layer in learning:
        layer.update_running_mean = False
    try:
        yield
    finally:
        for layer in learning:
            layer.update_running_mean = True
