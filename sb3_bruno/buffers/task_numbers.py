"""Gives tasks numbers, and finds the number of a task again: arrays only, and no dictionary of all tasks."""

from __future__ import annotations

from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

N_REMEMBERED = 1_024
"""Tasks whose numbers are found without a look at the others."""


class TaskNumbers:
    """Numbers task vectors, and uses the number of a task that is closed for one that is opened later.

    A dictionary would take 130 bytes for each task. Four of a checksum do: the few tasks that share one are compared.

    Attributes:
        vectors: the task of each number, (capacity, task_dim); NaN where there is none.
    """

    def __init__(self) -> None:
        self.vectors = np.empty((0, 0), dtype=np.float32)
        self._checksums = np.empty(0, dtype=np.uint32)
        self._free: list[int] = []
        self._n_used = 0  # numbers that are, or were, given to a task
        self._remembered: dict[bytes, int] = {}

    def __len__(self) -> int:
        """How many tasks have a number."""
        return self._n_used - len(self._free)

    def find(self, task: NDArray[np.float32]) -> int | None:
        """Return the number of a task, (task_dim,); None if it has none."""
        key = task.tobytes()
        number = self._remembered.get(key)
        if number is None:
            alike = np.flatnonzero(self._checksums[: self._n_used] == crc32(key))
            number = next((int(i) for i in alike if self.vectors[i].tobytes() == key), None)
        return None if number is None else self._remember(key, number)

    def checksums(self, numbers: NDArray[np.int64]) -> NDArray[np.uint32]:
        """Return the checksums of the tasks of numbers, (n,)."""
        return self._checksums[numbers]

    def open(self, task: NDArray[np.float32]) -> int:
        """Give a number to a task that has none."""
        number = self._free.pop() if self._free else self._n_used
        if number == len(self.vectors):
            if number == 0:
                self.vectors = np.empty((0, len(task)), dtype=np.float32)
            self.vectors, self._checksums = grown(self.vectors), grown(self._checksums)
        self._n_used = max(self._n_used, number + 1)
        key = task.tobytes()
        self.vectors[number], self._checksums[number] = task, crc32(key)
        return self._remember(key, number)

    def close(self, number: int) -> None:
        """Take its number from a task."""
        self._remembered.pop(self.vectors[number].tobytes(), None)
        self.vectors[number] = np.nan  # which equals no task
        self._free.append(number)

    def _remember(self, key: bytes, number: int) -> int:
        if len(self._remembered) == N_REMEMBERED:
            self._remembered.clear()
        self._remembered[key] = number
        return number


def grown(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array of an eighth as many entries again, of which the first are those of this one."""
    return np.concatenate([array, np.empty_like(array, shape=(max(len(array) // 8, 16), *array.shape[1:]))])
