"""Sequences of one task each with the belief at every step, and the random order in which they are read."""

from __future__ import annotations

import numpy as np
import torch as th
from numpy.typing import NDArray

from sb3_bruno.encoders import Transitions

Slots = NDArray[np.int64]
"""Places in a replay buffer, or indices into such; any shape."""


class EncodedSequences:
    """Sequences with the belief at every step, read in a random order without repetition.

    :param slots: shape (n_sequences, time)
    :param lengths: how many steps of each row are real, shape (n_sequences,)
    :param rng: shuffles the steps of each row
    :param tensors: tasks (n_sequences, task_dim), transitions (n_sequences, time, dim), and beliefs
        (n_sequences, time + 1, belief_dim), of which entry t has seen the first t transitions
    """

    def __init__(
        self,
        slots: Slots,
        lengths: Slots,
        rng: np.random.Generator,
        tensors: tuple[th.Tensor, Transitions, th.Tensor],
    ) -> None:
        self.slots = slots
        self.tensors = tensors
        self._lengths = lengths
        padding = np.arange(slots.shape[1]) >= lengths[:, None]
        self._order = np.argsort(rng.random(slots.shape) + padding, axis=1)  # real steps first, shuffled
        self._n_read = 0

    def has(self, n_sequences: int, per_row: int) -> bool:
        """Whether ``per_row`` unread steps are left in the longest of ``n_sequences`` rows."""
        return len(self._lengths) == n_sequences and self._n_read + per_row <= int(self._lengths.max())

    def read(self, batch_size: int, per_row: int) -> tuple[Slots, Slots]:
        """The next ``batch_size`` places (row, step), spread evenly over the rows; a short row goes round again.

        Example: 5 places in 2 rows are in rows 0 1 0 1 0, in each row at the steps that its shuffled order has next.
        """
        turns = np.arange(self._n_read, self._n_read + per_row) % self._lengths[:, None]
        self._n_read += per_row
        steps = np.take_along_axis(self._order, turns, axis=1)
        rows = np.tile(np.arange(len(steps)), per_row)
        return rows[:batch_size], steps.T.ravel()[:batch_size]
