r"""A causal transformer reads an episode in its order; each of its layers sees the last 64 transitions.

    x_t = W (s_t, a_t, r_t, s'_t) + b
    x <- x + attention(norm(x)),  x <- x + MLP(norm(x))  in each layer
    attention of step i to step j, 0 <= i - j < 64:  softmax_j(q_i k_j / sqrt(d) + c_{i - j})
    belief = norm(x_t) after the last layer; before the first transition 0

Positions are relative: c is learned for each layer, head and distance, so an episode may be longer than those learned
from. An agent carries the keys and values of the last 64 transitions. The gradient of the critics' loss teaches it.
References: Vaswani et al., Attention Is All You Need (2017, arXiv 1706.03762); with an off-policy actor-critic,
Grigsby, Fan and Zhu, AMAGO (2024, arXiv 2310.09971). Deviations: ``docs/encoders.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, TypedDict

import torch as th
from torch import Tensor, nn
from torch.nn import functional as F

from sb3_bruno.encoders.attention import WindowedLayer
from sb3_bruno.encoders.base import Order, TaskEncoder, Teacher, Transitions
from sb3_bruno.encoders.choices import check_least
from sb3_bruno.encoders.counted import counted_first, flat, last_of_counted, prefixes_of_counted


class TransformerArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``CausalTransformer``."""

    hidden_size: int
    n_layers: int
    n_heads: int
    window: int


class TransformerMemory(NamedTuple):
    """What a causal transformer keeps.

    Attributes:
        output: of the last layer at the last transition, shape (..., hidden_size).
        window: the last transitions, oldest first, zeros before the first, shape (..., window * 2 * n_layers *
            hidden_size): of each the keys and values of each layer.
        n: how many transitions are in the window, shape (..., 1).
    """

    output: Tensor
    window: Tensor
    n: Tensor


class CausalTransformer(TaskEncoder[TransformerMemory]):
    """Creates a transformer as a task encoder.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        hidden_size: size of the belief, and of what each layer reads and writes; a quarter of its hidden layer.
        n_layers: number of layers.
        n_heads: number of heads of each layer.
        window: how many transitions each layer sees.

    Raises:
        ValueError: if a number is not positive, or ``n_heads`` does not divide ``hidden_size``.
    """

    order: Order = "time"
    learns_from: Teacher = "critic"
    learning_rate: ClassVar[float] = 3e-4
    max_grad_norm: float | None = 1.0
    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {"hidden_size": (32, 64), "window": (32, 64, 200)}

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        hidden_size: int = 32,
        n_layers: int = 2,
        n_heads: int = 4,
        window: int = 64,
    ) -> None:
        super().__init__()
        sizes = {"hidden_size": hidden_size, "n_layers": n_layers, "n_heads": n_heads, "window": window}
        for name, value in sizes.items():
            check_least(name, value, 1)
        if hidden_size % n_heads:
            raise ValueError(f"`n_heads={n_heads}` does not divide `hidden_size={hidden_size}`: give one that does.")
        self.belief_dim = hidden_size
        self.embedding = nn.Linear(2 * observation_dim + action_dim + 1, hidden_size)
        # Any: a ModuleList does not tell type checkers what it holds.
        self.layers: Any = nn.ModuleList(WindowedLayer(hidden_size, n_heads, window) for _ in range(n_layers))
        self.norm = nn.LayerNorm(hidden_size)
        self._window = window

    def empty(self, batch_shape: tuple[int, ...] = ()) -> TransformerMemory:
        zeros = self.embedding.weight.new_zeros(*batch_shape, self._window * 2 * len(self.layers) * self.belief_dim)
        return TransformerMemory(zeros[..., : self.belief_dim], zeros, zeros[..., :1])

    def absorb(self, memory: TransformerMemory, transitions: Transitions) -> TransformerMemory:
        x = self.embedding(th.cat(transitions, dim=-1))
        n = (memory.n + 1).clamp(max=self._window)
        windows = []
        before = memory.window.unflatten(-1, (self._window, -1)).chunk(len(self.layers), dim=-1)
        for layer, past in zip(self.layers, before, strict=True):
            seen = th.cat([past[..., 1:, :], layer.keys_and_values(x).unsqueeze(-2)], dim=-2)
            x = layer.last(x, seen, n)
            windows.append(seen)
        return TransformerMemory(self.norm(x), th.cat(windows, dim=-1).flatten(-2), n)

    def prefixes(self, transitions: Transitions, weights: Tensor | None = None) -> TransformerMemory:
        """Run all layers once over what counts, then look up each prefix. Its windows are views, if all count."""
        batch_shape, counted, memory = self._run(transitions, weights)
        if counted is not None:
            memory = TransformerMemory(*(prefixes_of_counted(states, counted) for states in memory))
        return TransformerMemory(*(states.reshape(*batch_shape, *states.shape[1:]) for states in memory))

    def last(self, transitions: Transitions, weights: Tensor | None = None) -> TransformerMemory:
        """Make the memory of all transitions, without the windows of the prefixes before."""
        if transitions.rewards.numel() == 0:
            return super().last(transitions, weights)
        batch_shape, counted, memory = self._run(transitions, weights)
        if counted is None:
            memory = TransformerMemory(*(states[:, -1] for states in memory))
        else:
            memory = TransformerMemory(*(last_of_counted(states, counted) for states in memory))
        return TransformerMemory(*(states.reshape(*batch_shape, *states.shape[1:]) for states in memory))

    def prefix_beliefs(self, transitions: Transitions, weights: Tensor | None, noise: TransformerMemory) -> Tensor:
        """Read the beliefs of prefixes, without the windows, which are 64 times as large."""
        batch_shape, counted, memory = self._run(transitions, weights)
        beliefs = memory.output if counted is None else prefixes_of_counted(memory.output, counted)
        return beliefs.reshape(*batch_shape, *beliefs.shape[1:])

    def belief(self, memory: TransformerMemory) -> Tensor:
        return memory.output

    def _run(
        self, transitions: Transitions, weights: Tensor | None
    ) -> tuple[tuple[int, ...], Tensor | None, TransformerMemory]:
        """Run all layers over what counts.

        Returns:
            The batch shape, the weights (batch, time) unless all count, and the memories before and after each
            transition that counts, batch shape (batch, time + 1), whose windows are views.
        """
        x = self.embedding(th.cat(transitions.blanked(weights), dim=-1))
        batch_shape = tuple(x.shape[:-2])
        x, counted = flat(x, weights)
        if counted is not None and counted.all():  # there is nothing to look up, nor any windows to copy
            counted = None
        if counted is not None:
            x = counted_first(x, counted)
        seen = []
        for layer in self.layers:
            seen.append(layer.keys_and_values(x))
            x = layer(x, seen[-1])
        output = F.pad(self.norm(x), (0, 0, 1, 0))
        windows = F.pad(th.cat(seen, dim=-1), (0, 0, self._window, 0)).unfold(1, self._window, 1)
        n = th.arange(output.shape[1], device=output.device).clamp(max=self._window).to(output)
        n = n.reshape(1, -1, 1).expand(len(output), -1, 1)
        return batch_shape, counted, TransformerMemory(output, windows.transpose(-1, -2).flatten(2), n)
