"""Chooses the tasks that a read-out must not fit, so that they tell how far it is off on tasks that are new to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ONE_IN = 5
"""How many tasks there are for each that is spared."""
_AT_AN_END = np.uint64(2**32)  # beyond every checksum
_NEVER = np.uint64(2**33)  # beyond every other rank


def spared_tasks(tasks: NDArray[np.float32], checksums: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Choose one task in five by its checksum, so it is the same whenever the tasks are, in whatever order they came.

    Those that are spared lie between others: a read-out that was never taught the end of a range would be far off
    there, and tell of that everywhere. So a task at an end of an entry is spared only where others share that end and
    there are no tasks between, as of entries that are 0 or 1.

    Example: of 0, 1, ..., 10 two are spared, none of which is 0 or 10.

    Args:
        tasks: all that there are, (n, task_dim).
        checksums: of them, (n,).

    Returns:
        Their places, at most n // 5. They are fewer where more of the others are needed, each to reach an end of an
        entry.
    """
    n_spared = len(tasks) // ONE_IN
    if n_spared == 0:
        return np.empty(0, dtype=np.int64)
    least, greatest = tasks.min(axis=0), tasks.max(axis=0)
    varies = least < greatest
    is_end = np.concatenate([tasks == least, tasks == greatest], axis=1)[:, np.tile(varies, 2)]  # (n, 2 * n_varying)
    ranks = checksums + _AT_AN_END * is_end.any(axis=1)  # the lowest are spared
    needed = np.argmax(np.where(is_end, ranks[:, None], 0), axis=0)  # one for each end
    ranks[needed] = _NEVER
    lowest = np.argpartition(ranks, n_spared - 1)[:n_spared]
    return lowest[ranks[lowest] < _NEVER]
