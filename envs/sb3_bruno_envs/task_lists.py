"""Lists tasks as plain numbers, which an environment in another process can send."""

from __future__ import annotations

import numpy as np

from sb3_bruno_envs.tasks import Split, TaskDistribution, TaskSet


def list_few(distribution: TaskDistribution, most: int) -> list[list[float]] | None:
    """List the training tasks if these are at most so many, and those of the test among them; else None."""
    if not isinstance(distribution, TaskSet) or len(distribution.tasks("train")) > most:
        return None
    train = dict.fromkeys(map(tuple, distribution.tasks("train").tolist()))
    test = set(map(tuple, distribution.tasks("test").tolist()))
    return [list(task) for task in train] if test <= train.keys() else None


def list_examples(distribution: TaskDistribution, split: Split, most: int) -> list[list[float]]:
    """List the first tasks of a split, or, where these are endless, so many drawn by a generator of their own."""
    if isinstance(distribution, TaskSet):
        listed: list[list[float]] = distribution.tasks(split)[:most].tolist()
        return listed
    rng = np.random.default_rng(0)
    return [distribution.draw(rng, split).tolist() for _ in range(most)]
