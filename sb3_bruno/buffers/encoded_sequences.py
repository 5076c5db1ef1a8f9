"""Sequences of samples with the belief at every step, and the random order in which they are read."""

from __future__ import annotations

import numpy as np
import torch as th
from numpy.typing import NDArray
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from sb3_bruno.buffers.critic_gradient import BeliefGradient


class EncodedSequences:
    """Reads samples, in sequences of one task each, in a random order without repetition.

    A short row goes round again. Example: with rows of 3 and 2 steps, shuffled to a b c and d e, the order of all
    samples is a d b e c d.

    Args:
        samples: every entry of shape (n_sequences, time, dim).
        is_read: which steps of each row are to be read, shape (n_sequences, time).
        rng: shuffles the steps of each row.
        n_turns: how many steps of each row may be read at least, however short the rows are.
        gradient: takes the gradient of a loss back to the beliefs in the samples; None where no loss teaches them.
    """

    def __init__(
        self,
        samples: ReplayBufferSamples,
        is_read: NDArray[np.bool_],
        rng: np.random.Generator,
        n_turns: int = 1,
        gradient: BeliefGradient | None = None,
    ) -> None:
        self.gradient = gradient
        self.n_sequences, self.time = is_read.shape
        lengths = is_read.sum(axis=1)
        order = np.argsort(rng.random(is_read.shape) + ~is_read, axis=1)  # those to be read first, shuffled
        self._n_left = self._longest = int(lengths.max())
        turns = np.arange(max(self._longest, n_turns)) % lengths[:, None]
        places = np.take_along_axis(order, turns, axis=1) + self.time * np.arange(self.n_sequences)[:, None]
        entries = [entry.flatten(0, 1) for entry in samples if entry is not None]
        self._widths = [entry.shape[-1] for entry in entries]
        # Packed, so that a sample is read by one operation; and the order of all samples crosses to the device at once.
        self._packed = th.cat(entries, dim=-1)
        self._places = th.as_tensor(places.T.ravel(), device=self._packed.device)

    def has(self, n_sequences: int, per_row: int) -> bool:
        """Tell whether ``per_row`` unread steps are left in the longest of ``n_sequences`` rows."""
        return self.n_sequences == n_sequences and per_row <= self._n_left

    def read(self, batch_size: int, per_row: int) -> ReplayBufferSamples:
        """Read the next ``batch_size`` samples, spread evenly over the rows: ``per_row`` of each, but for the last."""
        begin = (self._longest - self._n_left) * self.n_sequences
        self._n_left -= per_row
        places = self._places[begin : begin + batch_size]
        samples = ReplayBufferSamples(*self._packed.index_select(0, places).split(self._widths, dim=-1))
        if self.gradient is None:
            return samples
        return samples._replace(observations=self.gradient.leaf(samples.observations, places))
