r"""SplAgger's encoder: one half of a recurrent network's output passes, of the other half the running maximum does.

    h_0 = 0, h_t = GRU(h_{t-1}, phi(s_t, a_t, r_t, s'_t)),  m_0 = 0, m_t = max(m_{t-1}, second half of h_t)
    belief = W (first half of h_t, m_t) + b

The first half may remember an order, and the second cannot forget what it saw once. The gradient of the critics' loss
teaches both. Reference: Beck, Jackson, Vuorio, Xiong and Whiteson, SplAgger: Split Aggregation for Meta-Reinforcement
Learning (2024, arXiv 2403.03020), and its code. Deviations: ``docs/encoders.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple, TypedDict

import torch as th
from torch import Tensor, nn
from torch.nn import functional as F

from sb3_bruno.encoders.base import Order, TaskEncoder, Teacher, Transitions
from sb3_bruno.encoders.choices import check_choice, check_least
from sb3_bruno.encoders.recurrent import RecurrentEncoder, RecurrentMemory

Reduction = Literal["max", "mean"]


class SplitArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``SplitAggregator``."""

    hidden_size: int
    output_dim: int
    rnn: bool
    reduce: Reduction


class SplitMemory(NamedTuple):
    """What a split aggregator keeps.

    Attributes:
        hidden: h, shape (..., hidden_size); without a network (..., 0).
        reduced: the maximum or the sum so far, shape (..., hidden_size / 2); without a network (..., hidden_size).
        n: of a sum, how many it has, shape (..., 1); of a maximum (..., 0).
    """

    hidden: Tensor
    reduced: Tensor
    n: Tensor


class SplitAggregator(TaskEncoder[SplitMemory]):
    """Creates SplAgger's task encoder.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        hidden_size: size of the hidden state, both halves, and of the layer before it.
        output_dim: size of the belief.
        rnn: False: no network; all features phi, after a ReLU, are reduced, and their order does not matter.
        reduce: how: ``"max"`` or ``"mean"``.

    Raises:
        ValueError: if ``reduce`` is none of the above, or a size is not positive, or one that is halved is odd.
    """

    order: Order = "time"
    learns_from: Teacher = "critic"
    learning_rate: ClassVar[float] = 1e-4  # as of the recurrent encoder
    max_grad_norm: float | None = 1.0
    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {"reduce": ("max", "mean"), "hidden_size": (32, 64, 128)}

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        hidden_size: int = 64,
        output_dim: int = 24,
        rnn: bool = True,
        reduce: Reduction = "max",
    ) -> None:
        super().__init__()
        check_choice("reduce", reduce, Reduction)
        check_least("hidden_size", hidden_size, 1)
        check_least("output_dim", output_dim, 1)
        if rnn and hidden_size % 2:
            raise ValueError(f"`hidden_size={hidden_size}` has no halves to split: give an even number.")
        self.order = "time" if rnn else "any"
        self.belief_dim = output_dim
        self._n_passing = hidden_size // 2 if rnn else 0
        self._n_reduced = hidden_size - self._n_passing
        self._reduce = reduce
        reader = RecurrentEncoder(observation_dim, action_dim, hidden_size=hidden_size)
        self.reader: RecurrentEncoder | nn.Sequential = reader if rnn else reader.features
        self.head = nn.Linear(hidden_size, output_dim)

    def empty(self, batch_shape: tuple[int, ...] = ()) -> SplitMemory:
        zeros = self.head.weight.new_zeros(*batch_shape, self.head.in_features)
        return SplitMemory(
            zeros if isinstance(self.reader, RecurrentEncoder) else zeros[..., :0],
            zeros[..., : self._n_reduced],
            zeros[..., : int(self._reduce == "mean")],
        )

    def absorb(self, memory: SplitMemory, transitions: Transitions) -> SplitMemory:
        hidden = memory.hidden
        if isinstance(self.reader, RecurrentEncoder):
            hidden = output = self.reader.absorb(RecurrentMemory(hidden, hidden[..., :0]), transitions).hidden
        else:
            output = self.reader(th.cat(transitions, dim=-1))
        output = output[..., self._n_passing :]
        if self._reduce == "max":
            return SplitMemory(hidden, th.maximum(memory.reduced, output), memory.n)
        return SplitMemory(hidden, memory.reduced + output, memory.n + 1)

    def prefixes(self, transitions: Transitions, weights: Tensor | None = None) -> SplitMemory:
        if weights is None:
            weights = th.ones_like(transitions.rewards[..., 0])
        counted = weights.unsqueeze(-1)
        if isinstance(self.reader, RecurrentEncoder):
            counted = (counted > 0).to(counted)  # in an order, once
            hidden = self.reader.prefixes(transitions, weights).hidden
            output = hidden[..., 1:, :]
        else:
            output = self.reader(th.cat(transitions.blanked(weights), dim=-1))
            hidden = F.pad(output[..., :0], (0, 0, 1, 0))
        output = th.where(counted > 0, output[..., self._n_passing :], 0.0)
        if self._reduce == "max":  # not below 0, where it starts
            reduced = F.pad(output, (0, 0, 1, 0)).cummax(dim=-2).values
            return SplitMemory(hidden, reduced, hidden[..., :0])
        reduced, n = (F.pad(x.cumsum(dim=-2), (0, 0, 1, 0)) for x in (counted * output, counted))
        return SplitMemory(hidden, reduced, n)

    def belief(self, memory: SplitMemory) -> Tensor:
        reduced = memory.reduced
        if self._reduce == "mean":
            reduced = reduced / th.where(memory.n > 0, memory.n, 1.0)
        belief: Tensor = self.head(th.cat([memory.hidden[..., : self._n_passing], reduced], dim=-1))
        return belief
