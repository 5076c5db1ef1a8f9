"""The way of an actor-critic's loss back to the beliefs that its samples were made from.

SB3's losses see a sample as a *leaf*: the whole flat observation, cut off from the encoder. So several samples may be
read from one encode, no graph is freed twice, and no training loop is copied. Once SB3 has differentiated a loss, the
leaf's ``grad`` holds the loss's gradient at the sampled beliefs. It is collected here, scattered back to the sequences
and steps that the samples came from, and at last sent through the encoder.
"""

from __future__ import annotations

import torch as th
from torch import Tensor

from sb3_bruno.encoders import TaskSequences


class BeliefGradient:
    """Collects a loss's gradient at the beliefs of one encode, over all samples that are read from it.

    Args:
        sequences: what was encoded.
        beliefs: at each transition, with their graph, shape (n_sequences, time, belief_dim).
        columns: where the belief stands in the extended observation.
    """

    def __init__(self, sequences: TaskSequences, beliefs: Tensor, columns: slice) -> None:
        self.sequences = sequences
        self.n_collected = 0
        self._beliefs = beliefs
        self._columns = columns
        self._gradient = th.zeros_like(beliefs).flatten(0, 1)  # (n_sequences * time, belief_dim)

    def leaf(self, observations: Tensor, places: Tensor) -> Tensor:
        """Make the leaf of a sample.

        Args:
            observations: extended observations, shape (batch, dim).
            places: which belief each of them holds, shape (batch,). Place = sequence * time + step.

        Returns:
            The observations, where a loss's gradient will be found, shape (batch, dim).
        """
        self._leaf, self._places = observations.detach().requires_grad_(), places
        return self._leaf

    def drop(self) -> None:
        """Forget what has arrived at the leaf: the gradient of a loss that does not teach the encoder."""
        self._leaf.grad = None

    def collect(self) -> None:
        """Add what has arrived at the leaf to the gradient at the beliefs. A belief sampled twice counts twice."""
        assert self._leaf.grad is not None  # the loss was differentiated
        self._gradient.index_add_(0, self._places, self._leaf.grad[:, self._columns])
        self.n_collected += 1
        self.drop()

    def backward(self) -> None:
        """Send the gradient of the mean loss over the collected samples through the encoder. Once."""
        self._beliefs.backward(self._gradient.view_as(self._beliefs) / self.n_collected)
