"""What the algorithm asks of a task encoder: a memory that absorbs transitions, a belief read off it, and a loss.

Torch only. An encoder knows transitions, not environments, buffers or policies. What only some encoders can do is in
``abilities.py``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar, Generic, Literal, NamedTuple, Self

import torch as th
from torch import Tensor, nn
from typing_extensions import TypeVar

AnyMemory = tuple[Tensor, ...]
"""What an encoder keeps of the transitions absorbed: tensors of shape (..., anything), batch dimensions first.

Any NamedTuple of tensors serves; its names make the encoder readable.
"""
Memory = TypeVar("Memory", bound=AnyMemory, default=Any)

Order = Literal["any", "time"]
Teacher = Literal["own", "critic", "actor"]


class Transitions(NamedTuple):
    """A batch of transitions (s, a, r, s') in the form in which the agent observes them.

    Attributes:
        observations: s, shape (..., observation_dim).
        actions: a, scaled to [-1, 1], shape (..., action_dim).
        rewards: r, shape (..., 1).
        next_observations: s', shape (..., observation_dim).
    """

    observations: Tensor
    actions: Tensor
    rewards: Tensor
    next_observations: Tensor

    def blanked(self, weights: Tensor | None) -> Transitions:
        """Put zeros where a transition's weight, shape (..., time), is 0: padding may hold anything.

        A product with 0 would not leave NaN or infinity out, nor would a choice keep it from the gradient.
        """
        if weights is None:
            return self
        counts = weights.unsqueeze(-1) > 0
        return Transitions(*(th.where(counts, column, 0.0) for column in self))


class TaskSequences(NamedTuple):
    """Sequences of transitions of one task each: what an encoder learns from.

    Attributes:
        transitions: shape (batch, time, dim). Whole episodes in their order for an encoder of order "time", else
            exchangeable.
        tasks: the true task of each sequence, shape (batch, task_dim). Privileged: for losses, never for beliefs.
        weights: 1 where a transition counts, 0 where it is padding or the agent never absorbed it, shape (batch, time).
            None: all count. For an encoder of order "any", k counts a transition k times.
    """

    transitions: Transitions
    tasks: Tensor
    weights: Tensor | None = None


class Loss(NamedTuple):
    """A loss and what to log of it.

    Attributes:
        total: what to minimise, shape ().
        scalars: by name, tensors of shape (), which stay on their device.
    """

    total: Tensor
    scalars: Mapping[str, Tensor]


class TaskEncoder(nn.Module, ABC, Generic[Memory]):
    """Infers the hidden task from transitions.

    A belief is a function of the memory: an encoder that samples keeps its noise in there. A subclass takes
    ``(observation_dim, action_dim, **encoder_kwargs)``, calls ``super().__init__()`` and sets ``belief_dim``.

    Attributes:
        belief_dim: size of the vector that stands for the belief in the extended observation.
        order: "any" if the belief does not depend on the order of the transitions; "time" if the encoder must read
            whole episodes in their order.
        learns_from: "own" for an encoder with a ``loss``, trained by itself. "critic" or "actor" for one that learns
            from the gradient of that loss of the actor-critic at the beliefs; a ``loss``, if it has one, is added.
        learning_rate: of its Adam, unless the algorithm is given one.
        max_grad_norm: norm to which its gradient is clipped; None: never.
        shortest_sequence: how many transitions of a task ``loss`` needs at least.
        needs_trial: whether it needs several episodes of a task, as a ``Trial`` joins them.
        search_space: keyword arguments worth searching, each with the values to choose from; a ``range`` is searched
            as an integer.
    """

    belief_dim: int
    order: Order = "any"
    learns_from: Teacher = "own"
    learning_rate: ClassVar[float] = 1e-3
    max_grad_norm: float | None = None
    shortest_sequence: int = 1
    needs_trial: bool = False
    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {}

    @classmethod
    def build(cls, observation_dim: int, action_dim: int, task_dim: int, **kwargs: Any) -> Self:
        """Build the encoder for an environment. Override it to use ``task_dim``.

        Args:
            observation_dim: size of the flattened observation.
            action_dim: size of the flattened action.
            task_dim: size of the task vector.
            **kwargs: the ``encoder_kwargs``.
        """
        return cls(observation_dim, action_dim, **kwargs)

    def check_tasks(self, tasks: Tensor) -> None:
        """Refuse tasks that it cannot learn from, (n, task_dim). Asked where a model is made, of the env's tasks.

        Raises:
            ValueError: naming the task and the remedy.
        """

    @abstractmethod
    def empty(self, batch_shape: tuple[int, ...] = ()) -> Memory:
        """Make the memory of no transitions: the prior."""

    @abstractmethod
    def absorb(self, memory: Memory, transitions: Transitions) -> Memory:
        """Add one more transition each, (..., dim), to the memory."""

    @abstractmethod
    def prefixes(self, transitions: Transitions, weights: Tensor | None = None) -> Memory:
        """Make the memories of the first 0, 1, ..., time transitions: (..., time, dim) -> (..., time + 1, ...).

        A transition of weight 1 in weights (..., time) is absorbed, one of weight 0 is not. None: all are. An encoder
        of order "any" absorbs one of weight k as if k times; k need not be whole. One of order "time" absorbs it once.
        """

    def last(self, transitions: Transitions, weights: Tensor | None = None) -> Memory:
        """Make the last memory of ``prefixes``, that of all transitions: (..., time, dim) -> (...). Of none, the prior.

        Override it where that is cheaper than to make the memories of all prefixes.
        """
        batch_shape = tuple(transitions.rewards.shape[:-2])
        if transitions.rewards.numel() == 0:  # torch runs no flow or recurrent network on nothing
            return self.empty(batch_shape)
        return map_memory(lambda states: states.select(len(batch_shape), -1), self.prefixes(transitions, weights))

    @abstractmethod
    def belief(self, memory: Memory) -> Tensor:
        """Read the belief off a memory, as a vector for actor and critics, shape (..., belief_dim)."""

    @property
    def is_frozen(self) -> bool:
        """Whether no parameter can learn: there is none, or all are constants."""
        return not any(parameter.requires_grad for parameter in self.parameters())

    def count(self, memory: Memory) -> Tensor | None:
        """Count the values that a memory has absorbed, (..., 1). None: it does not tell."""
        return None

    def start_episode(self, memory: Memory) -> Memory:
        """Begin an episode of a task, its first or another. The memory stays as it is, unless an encoder samples."""
        return memory

    def redraw(self, memory: Memory) -> Memory:
        """Draw the noise in a memory anew. An encoder that samples says how; others keep none.

        The replay buffer learns from beliefs with noise, drawn once for each sequence.
        """
        return memory

    def with_noise_of(self, memory: Memory, other: Memory) -> Memory:
        """Give a memory what another keeps beside its transitions: its noise, and what was drawn in its episode.

        Args:
            memory: batch shape (...).
            other: a batch shape that can be expanded to that.
        """
        return memory

    def prefix_beliefs(self, transitions: Transitions, weights: Tensor | None, noise: Memory) -> Tensor:
        """Read the beliefs of ``prefixes``, with the noise in a memory of batch shape (..., 1) or (..., time + 1).

        Override it where that is cheaper than to make the memories. -> (..., time + 1, belief_dim)
        """
        return self.belief(self.with_noise_of(self.prefixes(transitions, weights), noise))

    def loss(self, sequences: TaskSequences) -> Loss | None:
        """Score sequences that each come from one task. None: there is nothing to learn from them alone."""
        return None

    def diagnostics(self) -> Mapping[str, Tensor]:
        """Tell scalars worth a line in the log, by name: tensors of shape (), left on their device."""
        return {}


@contextmanager
def training_mode(encoder: TaskEncoder) -> Iterator[None]:
    """Put an encoder into training mode for as long as it learns, and back, whatever happens."""
    encoder.train()
    try:
        yield
    finally:
        encoder.eval()


def map_memory(function: Callable[..., Tensor], *memories: Memory) -> Memory:
    """Apply a function to each tensor of a memory, or to those in the same place of several. The type is kept.

    Example:
        >>> map_memory(lambda x: x[:, -1], prefixes)  # the memories after the last transition
    """
    tensors = map(function, *memories)
    kind: Any = type(memories[0])
    made: Memory = kind._make(tensors) if hasattr(kind, "_make") else kind(tensors)
    return made


def choose_memory(mask: Tensor, yes: Memory, no: Memory) -> Memory:
    """Take the memory ``yes`` where the mask, shape (..., 1), is True, and ``no`` elsewhere."""

    def choose(a: Tensor, b: Tensor) -> Tensor:
        return th.where(mask.reshape(mask.shape[:-1] + (1,) * (a.ndim - mask.ndim + 1)), a, b)

    return map_memory(choose, yes, no)
