"""Sequences of samples with the belief at every step, and the random order in which they are read."""

from __future__ import annotations

import numpy as np
import torch as th
from numpy.typing import NDArray
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from sb3_bruno.buffers.critic_gradient import BeliefGradient


class EncodedSequences:
    """Reads samples, in sequences of one task each, in a random order without repetition.

    Args:
        samples: every entry of shape (n_sequences, time, dim).
        is_read: which steps of each row are to be read, shape (n_sequences, time).
        rng: shuffles the steps of each row.
        gradient: takes the gradient of a loss back to the beliefs in the samples; None where no loss teaches them.
    """

    def __init__(
        self,
        samples: ReplayBufferSamples,
        is_read: NDArray[np.bool_],
        rng: np.random.Generator,
        gradient: BeliefGradient | None = None,
    ) -> None:
        self.gradient = gradient
        self._samples = samples
        self._lengths = is_read.sum(axis=1)
        self._order = np.argsort(rng.random(is_read.shape) + ~is_read, axis=1)  # those to be read first, shuffled
        self._n_read = 0

    def has(self, n_sequences: int, per_row: int) -> bool:
        """Tell whether ``per_row`` unread steps are left in the longest of ``n_sequences`` rows."""
        return len(self._lengths) == n_sequences and self._n_read + per_row <= int(self._lengths.max())

    def read(self, batch_size: int, per_row: int) -> ReplayBufferSamples:
        """Read the next ``batch_size`` samples, spread evenly over the rows. A short row goes round again.

        Example: 5 samples of 2 rows are of rows 0 1 0 1 0, of each row the steps that its shuffled order has next.
        """
        turns = np.arange(self._n_read, self._n_read + per_row) % self._lengths[:, None]
        self._n_read += per_row
        steps = np.take_along_axis(self._order, turns, axis=1).T.ravel()[:batch_size]
        rows = np.tile(np.arange(len(self._order)), per_row)[:batch_size]
        places = th.as_tensor(rows * self._order.shape[1] + steps, device=self._samples.rewards.device)
        samples = ReplayBufferSamples(*(entry.flatten(0, 1)[places] for entry in self._samples if entry is not None))
        if self.gradient is None:
            return samples
        return samples._replace(observations=self.gradient.leaf(samples.observations, places))
