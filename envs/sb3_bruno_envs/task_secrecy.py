"""Says whether a first observation gives the task away; knows no algorithm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

Env: TypeAlias = gym.Env[Any, Any]

SEEDS = range(100)
_SUSPECT_CORRELATION = 0.5  # five standard deviations, for 100 independent pairs


class Remark(str):
    """A finding that may be as it should."""


def find_leaks(env: Env) -> Iterator[str]:
    """Look for each entry of the task in the first observations of many seeds."""
    tasks, firsts = _starts(env)
    suspects = []
    for i, task in enumerate(tasks):
        if np.ptp(task) > 0.0 and np.isclose(firsts, task, rtol=1e-6, atol=0.0).all(axis=1).any():
            yield f"the first observation contains task[{i}], a leak: take the task out of it."
        elif abs(_strongest_correlation(task, firsts)) > _SUSPECT_CORRELATION:
            suspects.append(i)
    if not suspects:
        return
    # With one task for all seeds, a first observation tells the seed's own task only by the seed.
    _, others = _starts(env, tasks[:, 0])
    for i in suspects:
        by_seed = _strongest_correlation(tasks[i], others)
        if abs(by_seed) > _SUSPECT_CORRELATION:
            yield (
                f"the first observation tells task[{i}] (correlation {by_seed:.2f}), a leak: "
                "draw tasks from a generator spawned from the seed, as MetaTask does."
            )
        else:
            yield Remark(
                f"The first observation tells task[{i}] (correlation {_strongest_correlation(tasks[i], firsts):.2f}), "
                "and not by the seed. If the reset takes a step, its physics show the task, which may be as it should; "
                "if the observation holds a number made from the task, take it out."
            )


def _starts(env: Env, given: NDArray[Any] | None = None) -> tuple[NDArray[Any], NDArray[Any]]:
    """Reset with many seeds; return tasks ``(task_dim, seeds)`` and what varies in first observations ``(n, seeds)``.

    The tasks are those that the seeds give, or the one ``given``, ``(task_dim,)``.
    """
    starts = [start(env, seed, given) for seed in SEEDS]
    firsts = np.stack([first for _, first in starts], axis=1)
    return np.stack([task for task, _ in starts], axis=1), firsts[np.ptp(firsts, axis=1) > 0.0]


def _strongest_correlation(task: NDArray[Any], firsts: NDArray[Any]) -> float:
    """Correlate an entry of the task, ``(seeds,)``, with each row of ``firsts``; return the strongest, 0 if none is."""
    if np.ptp(task) == 0.0 or len(firsts) == 0:
        return 0.0
    correlation = np.corrcoef(task, firsts)[0, 1:]
    return float(correlation[np.abs(correlation).argmax()])


def start(env: Env, seed: int, task: NDArray[Any] | None = None) -> tuple[NDArray[Any], NDArray[Any]]:
    """Reset; return the task ``(dim,)`` and the flat first observation ``(obs_dim,)``, empty if missing."""
    observation, info = env.reset(seed=seed, options=None if task is None else {"task": task})
    inner = observation.get("observation", []) if isinstance(observation, dict) else observation
    return np.ravel(info.get("task", [])), np.ravel(inner)
