"""Says whether tasks have an effect, and the same effect each time; knows no algorithm.

A function that applies tasks may do nothing, and nobody would see it: ``info`` names the task all the same.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from sb3_bruno_envs.task_episodes import (
    HOLDS,
    LONG,
    Plan,
    alike,
    any_effect,
    check_time,
    frozen_statistics,
    long_plans,
    play,
    short_plan,
)

Env: TypeAlias = gym.Env[Any, Any]

_N_TASKS = 5
_DRAWS = 8
_N_PAIRS = 3  # of tasks that differ in one entry
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
    plan = short_plan(env)
    with frozen_statistics(env):
        task = env.reset(seed=0)[1]["task"]
        first, again = play(env, [task, task], plan, deadline)
        if not alike(first, again, _ROUNDING):
            return _comes_differently(task)
        tasks = _distant_tasks(env, deadline)
        if len(tasks) < 2 or not _obeys(env, tasks[-1]):
            return None
        first, *others, last = play(env, [*tasks, tasks[0]], plan, deadline)
        if not alike(first, last, _ROUNDING):
            return _comes_differently(tasks[0])
        if any_effect(first, others):
            return None
        for plan in long_plans(env):
            first, *others = play(env, tasks, plan, deadline)
            if any_effect(first, others):
                return None
    return (
        f"{len(tasks)} tasks, from {tasks[0]} to {tasks[1]}, made no difference to {len(HOLDS)} episodes of up "
        f"to {LONG} steps: let apply_task write, for every task, what the environment reads. If the environment's own "
        "reset writes that too, use MetaTask(when='after_reset'); if a wrapper keeps it, MetaTask(unwrap=False)."
    )


def find_entries_without_effect(env: Env) -> Iterator[int]:
    """Change one entry of the task at a time; yield those that make no difference, if the task has several.

    Args:
        env: an environment with tasks in which ``find_task_without_effect`` finds nothing.
    """
    plans = [short_plan(env), *long_plans(env)]
    with frozen_statistics(env):
        tasks = np.stack(_distant_tasks(env))  # (n, dim)
        if tasks.shape[1] == 1 or not _obeys(env, tasks[-1]):
            return
        for i in np.flatnonzero(np.ptp(tasks, axis=0)).tolist():
            pairs = [_changed(tasks, task, i) for task in tasks[:_N_PAIRS]]
            if not any(_has_effect(env, pair, plan) for plan in plans for pair in pairs):
                yield i


def _changed(tasks: NDArray[Any], task: NDArray[Any], i: int) -> list[NDArray[Any]]:
    """Return a task, and a copy whose entry ``i`` is that of the task where it is furthest."""
    other = task.copy()
    other[i] = tasks[np.abs(tasks[:, i] - task[i]).argmax(), i]
    return [task, other]


def _has_effect(env: Env, pair: list[NDArray[Any]], plan: Plan) -> bool:
    try:
        first, other = play(env, pair, plan)
    except Exception:  # entries of two tasks need not make a third: [1, 1] is no one-hot
        return True
    return any_effect(first, [other])


def _comes_differently(task: NDArray[Any]) -> str:
    return (
        f"the task {task} gave another episode when it came again, with the same seed and actions: let apply_task "
        "write all that the task means, never a change relative to the last task, and draw numbers from "
        "self.np_random alone."
    )


def _distant_tasks(env: Env, deadline: float = np.inf) -> list[NDArray[Any]]:
    """Return up to ``_N_TASKS`` different tasks that resets give, each far from those before it."""
    seeds = [*range(_DRAWS), *[None] * _DRAWS]  # without a seed a cycle goes on
    tasks = []
    for seed in seeds:
        check_time(env, deadline)
        tasks.append(env.reset(seed=seed)[1]["task"])
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
