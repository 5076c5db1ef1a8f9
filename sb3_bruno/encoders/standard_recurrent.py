"""Reads an episode by a recurrent network, of transitions that running statistics standardise."""

from __future__ import annotations

from torch import Tensor

from sb3_bruno.encoders.base import Order, TaskEncoder, Transitions
from sb3_bruno.encoders.recurrent import Cell, RecurrentEncoder, RecurrentMemory
from sb3_bruno.encoders.variables import Variables


class StandardRecurrent(TaskEncoder[RecurrentMemory]):
    """Creates the part that recurrent encoders with a loss of their own share. What they believe is up to them.

    The network reads (s, a, r, s' - s), each standardised. ``loss`` must update the statistics, in training mode.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        cell: ``"gru"`` or ``"lstm"``.
        hidden_size: size of the hidden state, and of the layer before it.

    Attributes:
        variables: reads and standardises (s, a), s', r and s' - s.
        reader: the network, which keeps the memory.
    """

    order: Order = "time"
    max_grad_norm: float | None = 1.0

    def __init__(self, observation_dim: int, action_dim: int, cell: Cell, hidden_size: int) -> None:
        super().__init__()
        self._dims = [observation_dim, action_dim]
        self.variables = Variables(observation_dim, action_dim, "both", condition_on_next=True)
        self.reader = RecurrentEncoder(observation_dim, action_dim, cell=cell, hidden_size=hidden_size)

    def empty(self, batch_shape: tuple[int, ...] = ()) -> RecurrentMemory:
        return self.reader.empty(batch_shape)

    def absorb(self, memory: RecurrentMemory, transitions: Transitions) -> RecurrentMemory:
        return self.reader.absorb(memory, self._standardized(transitions))

    def prefixes(self, transitions: Transitions, weights: Tensor | None = None) -> RecurrentMemory:
        return self.reader.prefixes(self._standardized(transitions), weights)

    def _standardized(self, transitions: Transitions) -> Transitions:
        """Standardise transitions (..., dim), with s' - s in the place of s'."""
        values = self.variables(transitions)
        observations, actions = values.here.split(self._dims, dim=-1)
        return Transitions(observations, actions, values.rewards, values.changes)
