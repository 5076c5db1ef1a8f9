"""Sequences of samples with the belief at every step, and the random order in which they are read."""

from __future__ import annotations

import numpy as np
import torch as th
from numpy.typing import NDArray
from stable_baselines3.common.type_aliases import ReplayBufferSamples


class EncodedSequences:
    """Samples in sequences of one task each, read in a random order without repetition.

    :param samples: every entry of shape (n_sequences, time, dim)
    :param lengths: how many steps of each row are real, shape (n_sequences,)
    :param rng: shuffles the steps of each row
    """

    def __init__(self, samples: ReplayBufferSamples, lengths: NDArray[np.int64], rng: np.random.Generator) -> None:
        self._samples = samples
        self._lengths = lengths
        shape = tuple(samples.rewards.shape[:2])
        padding = np.arange(shape[1]) >= lengths[:, None]
        self._order = np.argsort(rng.random(shape) + padding, axis=1)  # real steps first, shuffled
        self._n_read = 0

    def has(self, n_sequences: int, per_row: int) -> bool:
        """Whether ``per_row`` unread steps are left in the longest of ``n_sequences`` rows."""
        return len(self._lengths) == n_sequences and self._n_read + per_row <= int(self._lengths.max())

    def read(self, batch_size: int, per_row: int) -> ReplayBufferSamples:
        """The next ``batch_size`` samples, spread evenly over the rows; a short row goes round again.

        Example: 5 samples of 2 rows are of rows 0 1 0 1 0, of each row the steps that its shuffled order has next.
        """
        turns = np.arange(self._n_read, self._n_read + per_row) % self._lengths[:, None]
        self._n_read += per_row
        steps = np.take_along_axis(self._order, turns, axis=1).T.ravel()[:batch_size]
        rows = np.tile(np.arange(len(self._order)), per_row)[:batch_size]
        places = th.as_tensor(rows * self._order.shape[1] + steps, device=self._samples.rewards.device)
        return ReplayBufferSamples(*(one.flatten(0, 1)[places] for one in self._samples if one is not None))
