"""Which slots of a ring buffer hold which episode: numpy only, knows neither transitions nor torch."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Slots = NDArray[np.int64]
"""Places in a ring buffer; slot = row * n_envs + env. Any shape."""


class EpisodeIndex:
    """Counts the steps of every environment's episodes, row by row, while a ring buffer overwrites its oldest row.

    Args:
        n_rows: rows of the ring, each of one transition per environment.
        n_envs: number of environments.
    """

    def __init__(self, n_rows: int, n_envs: int) -> None:
        self._steps = np.zeros((n_rows, n_envs), dtype=np.int32)  # transitions before this one in its episode
        self._lengths = np.zeros(n_envs, dtype=np.int64)  # of the episodes that run
        self._n_put = 0

    def __getstate__(self) -> dict[str, Any]:
        """Keep only the rows that are filled."""
        return {**self.__dict__, "_steps": self._steps[: self._n_put], "n_rows": len(self._steps)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        filled = state["_steps"]
        self.__dict__.update(state)
        self._steps = np.zeros((self.__dict__.pop("n_rows"), *filled.shape[1:]), dtype=np.int32)
        self._steps[: len(filled)] = filled

    def put(self, dones: NDArray[Any]) -> None:
        """Count one more transition of each environment; ``dones``, (n_envs,), tells whose episode ends with it."""
        self._steps[self._n_put % len(self._steps)] = self._lengths
        self._lengths = np.where(dones, 0, self._lengths + 1)
        self._n_put += 1

    @property
    def lengths(self) -> NDArray[np.int64]:
        """The transitions so far of the episodes that run, (n_envs,)."""
        return self._lengths

    def cut(self) -> None:
        """Begin new episodes with what comes next."""
        self._lengths[:] = 0

    def running(self) -> tuple[Slots, Slots]:
        """Find the episodes that still run, from their first transition that is left.

        Returns:
            Slots (n_envs, longest), rows padded with their last slot, and the lengths (n_envs,).
        """
        n_envs = len(self._lengths)
        return self._slots(np.full(n_envs, (self._n_put - 1) % len(self._steps)), np.arange(n_envs), self._lengths)

    def holding(self, slots: Slots) -> tuple[Slots, Slots]:
        """Find the episodes, as far as they are left, that hold given slots (n,).

        Returns:
            Slots (n, longest), rows padded with their last slot, and the lengths (n,).
        """
        n_envs = self._steps.shape[1]
        rows, envs = slots // n_envs, slots % n_envs
        last_rows = self._last_rows(rows, envs)
        return self._slots(last_rows, envs, self._steps[last_rows, envs].astype(np.int64) + 1)

    def _last_rows(self, rows: Slots, envs: Slots) -> Slots:
        """Find the last row, so far, of the episodes that hold given transitions. All shapes (n,).

        Within an episode the step counts up with the row, so row + k belongs to it while its step is step + k.
        Example: steps [3 4 5 0 1], row 1: k = 1 holds (5 = 4 + 1), k = 2 does not (0), so the last row is 2. Once
        it fails it fails for good, so k is found by bisection.
        """
        n_rows = len(self._steps)
        steps = self._steps[rows, envs]
        low, high = np.zeros_like(rows), (self._n_put - 1 - rows) % n_rows
        while (low < high).any():
            middle = (low + high + 1) // 2
            same = self._steps[(rows + middle) % n_rows, envs] == steps + middle
            low, high = np.where(same, middle, low), np.where(same, high, middle - 1)
        return (rows + low) % n_rows

    def _slots(self, last_rows: Slots, envs: Slots, lengths: Slots) -> tuple[Slots, Slots]:
        """Lay out the slots of ``lengths`` rows up to ``last_rows``, as far as they are left, padded with the last."""
        n_rows, n_envs = self._steps.shape
        oldest = max(self._n_put - n_rows, 0)
        lengths = np.minimum(lengths, (last_rows - oldest) % n_rows + 1)
        steps = np.minimum(np.arange(max(lengths.max(), 1)), np.maximum(lengths - 1, 0)[:, None])
        rows = (last_rows - np.maximum(lengths - 1, 0))[:, None] + steps
        return rows % n_rows * n_envs + envs[:, None], lengths
