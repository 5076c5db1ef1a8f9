"""A recurrent encoder: a GRU or LSTM reads an episode in its order, and its hidden state is the belief.

    h_0 = 0, h_t = RNN(h_{t-1}, phi(s_t, a_t, r_t, s'_t)), belief after t transitions = h_t

It has no loss of its own: the gradient of the critics' or the actor's loss teaches it. This is RL^2 (Duan et al. 2016,
arXiv 1611.02779) with an off-policy actor-critic, as in Ni, Eysenbach and Salakhutdinov, Recurrent Model-Free RL Can Be
a Strong Baseline for Many POMDPs (2022, arXiv 2110.05038). Deviations: ``docs/recurrent.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple, TypedDict

import torch as th
from torch import Tensor, nn
from torch.nn import functional as F

from sb3_bruno.encoders.base import Order, TaskEncoder, Teacher, Transitions
from sb3_bruno.encoders.choices import check_choice, check_least
from sb3_bruno.encoders.counted import counted_first, flat, prefixes_of_counted

Cell = Literal["gru", "lstm"]
_CELLS: dict[str, type[nn.GRU | nn.LSTM]] = {"gru": nn.GRU, "lstm": nn.LSTM}


class RecurrentArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``RecurrentEncoder``."""

    cell: Cell
    hidden_size: int
    learns_from: Teacher
    max_grad_norm: float | None


class RecurrentMemory(NamedTuple):
    """What a recurrent network keeps.

    Attributes:
        hidden: h, shape (..., hidden_size).
        cell: an LSTM's cell state, shape (..., hidden_size); of a GRU (..., 0).
    """

    hidden: Tensor
    cell: Tensor


class RecurrentEncoder(TaskEncoder[RecurrentMemory]):
    """Creates a recurrent task encoder.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        cell: ``"gru"`` or ``"lstm"``.
        hidden_size: size of the hidden state, which is the belief, and of the layer before it.
        learns_from: whose loss teaches it, ``"critic"`` or ``"actor"``.
        max_grad_norm: norm to which its gradient is clipped; None: never.

    Raises:
        ValueError: if ``cell`` or ``learns_from`` is none of the above, or a number is not positive.
    """

    order: Order = "time"
    learns_from: Teacher = "critic"
    learning_rate: ClassVar[float] = 1e-4  # well below the critics': Luo et al. (2024, arXiv 2405.15384)
    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {"cell": ("gru", "lstm"), "hidden_size": (32, 64, 128)}

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        cell: Cell = "gru",
        hidden_size: int = 64,
        learns_from: Teacher = "critic",
        max_grad_norm: float | None = 1.0,
    ) -> None:
        super().__init__()
        check_choice("cell", cell, Cell)
        if learns_from not in ("critic", "actor"):
            raise ValueError(f"`learns_from` must be 'critic' or 'actor', got {learns_from!r}: it has no own loss.")
        check_least("hidden_size", hidden_size, 1)
        if max_grad_norm is not None and not max_grad_norm > 0:
            raise ValueError(f"`max_grad_norm` must be positive, got {max_grad_norm}: None never clips.")
        self.learns_from = learns_from
        self.max_grad_norm = max_grad_norm
        self.belief_dim = hidden_size
        self.features = nn.Sequential(nn.Linear(2 * observation_dim + action_dim + 1, hidden_size), nn.ReLU())
        self.rnn = _CELLS[cell](hidden_size, hidden_size, batch_first=True)

    def empty(self, batch_shape: tuple[int, ...] = ()) -> RecurrentMemory:
        hidden = next(self.parameters()).new_zeros(*batch_shape, self.belief_dim)
        return RecurrentMemory(hidden, hidden if self._is_lstm else hidden[..., :0])

    def absorb(self, memory: RecurrentMemory, transitions: Transitions) -> RecurrentMemory:
        x = self.features(th.cat(transitions, dim=-1))
        one_step = x.reshape(-1, 1, x.shape[-1])
        hidden, cell = (states.reshape(1, len(one_step), -1).contiguous() for states in memory)  # as cuDNN needs them
        if self._is_lstm:
            _, (hidden, cell) = self.rnn(one_step, (hidden, cell))
            return RecurrentMemory(hidden.reshape(x.shape), cell.reshape(x.shape))
        _, hidden = self.rnn(one_step, hidden)
        return RecurrentMemory(hidden.reshape(x.shape), memory.cell)

    def prefixes(self, transitions: Transitions, weights: Tensor | None = None) -> RecurrentMemory:
        """Run the network once over what counts, then look up each prefix by how many transitions counted before it."""
        features = self.features(th.cat(transitions.blanked(weights), dim=-1))
        *batch_shape, time, _ = features.shape
        x, counted = flat(features, weights)
        if counted is not None:
            x = counted_first(x, counted)
        hidden = F.pad(self.rnn(x)[0], (0, 0, 1, 0))
        memory = RecurrentMemory(hidden, self._cells(x, hidden) if self._is_lstm else hidden[..., :0])
        if counted is not None:
            memory = RecurrentMemory(*(prefixes_of_counted(states, counted) for states in memory))
        return RecurrentMemory(*(states.reshape(*batch_shape, time + 1, states.shape[-1]) for states in memory))

    def belief(self, memory: RecurrentMemory) -> Tensor:
        return memory.hidden

    @property
    def _is_lstm(self) -> bool:
        return isinstance(self.rnn, nn.LSTM)

    @th.no_grad()
    def _cells(self, x: Tensor, hidden: Tensor) -> Tensor:
        """The LSTM's cell states, which torch tells at the end alone: c_t = f_t c_{t-1} + i_t g_t.

        With the hidden states known, all gates are one product. x: (batch, time, dim), hidden: (batch, time + 1, dim),
        the zeros of the start first -> (batch, time + 1, dim)
        """
        rnn: Any = self.rnn  # torch names its weights where no type checker sees them
        gates = F.linear(x, rnn.weight_ih_l0, rnn.bias_ih_l0) + F.linear(
            hidden[:, :-1], rnn.weight_hh_l0, rnn.bias_hh_l0
        )
        enter, keep, new, _ = gates.chunk(4, dim=-1)
        added, keep = enter.sigmoid() * new.tanh(), keep.sigmoid()
        cells = [th.zeros_like(hidden[:, 0])]
        for t in range(x.shape[1]):
            cells.append(keep[:, t] * cells[-1] + added[:, t])
        return th.stack(cells, dim=1)
