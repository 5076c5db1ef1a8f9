r"""A conditional neural process, or deep sets: the mean or the sum of learned embeddings of the transitions.

References: Garnelo et al., Conditional Neural Processes (2018, arXiv 1807.01613); Zaheer et al., Deep Sets (2017, arXiv
1703.06114).

.. math:: e_i = \phi(s_i, a_i, r_i, s'_i - s_i), \quad m = \frac{1}{n} \sum_i e_i \text{ or } \frac{1}{100} \sum_i e_i,
    \quad b = (\rho(m), \log(1 + n))

Its own loss is the neural process's, over transitions in and after the n that are known:

.. math:: L = -\text{mean}_n\, \text{mean}_j \log N(y_j \mid \mu(b, x_j), \sigma^2(b, x_j)), \quad
    \sigma = 0.1 + 0.9\, \text{softplus}

y is the standardised reward given x = (s, a, s'), s' - s given x = (s, a), or both. Taught by the critics or the actor
instead, it is deep sets, and has no decoder.

Deviations from the references; those of neural processes are from memory:

- The decoder reads the belief, not m: so actor and critics see all that it sees.
- log(1 + n) is appended, for a mean forgets how much was seen, and a sum grows with it.
- Of each sequence 16 values of n are scored, on 32 transitions each.
- Inputs and targets are standardised by running statistics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple, TypedDict

import torch as th
from torch import Tensor
from torch.distributions import Normal
from torch.nn import functional as F
from zuko.nn import MLP

from sb3_bruno.encoders.base import Loss, TaskEncoder, TaskSequences, Teacher, Transitions, map_memory
from sb3_bruno.encoders.choices import check_choice, check_layers, check_least
from sb3_bruno.encoders.decoder import Decoder
from sb3_bruno.encoders.draws import draw
from sb3_bruno.encoders.variables import Modelled, Variables

Aggregate = Literal["mean", "sum"]
EMBEDDING_DIM = 64
SUM_UNIT = 100.0
"""What a sum is divided by, so that it is of order 1 for some hundred transitions."""
DECODER = (64, 64)


class EmbeddingArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``MeanEmbedding``."""

    modelled: Modelled
    aggregate: Aggregate
    net_arch: Sequence[int]
    latent_dim: int
    learns_from: Teacher


class EmbeddingMemory(NamedTuple):
    """What is kept of a set of transitions.

    Attributes:
        n: how many, shape (..., 1).
        total: the sum of their embeddings, shape (..., 64).
    """

    n: Tensor
    total: Tensor


class MeanEmbedding(TaskEncoder[EmbeddingMemory]):
    """Creates a task encoder that averages, or sums, learned embeddings of transitions. Their order does not matter.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        modelled: what is predicted in its own loss: ``"rewards"``, ``"next_observations"`` or ``"both"``.
        aggregate: ``"mean"`` or ``"sum"``.
        net_arch: hidden layers of the network that embeds a transition.
        latent_dim: size of the belief, beside log(1 + n).
        learns_from: ``"own"``, the loss above; ``"critic"`` or ``"actor"``: that one's loss alone.

    Raises:
        ValueError: if an argument is none of the above, or a number is out of range.
    """

    max_grad_norm: float | None = 1.0
    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {"aggregate": ("mean", "sum"), "latent_dim": (5, 10, 32)}

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        modelled: Modelled = "both",
        aggregate: Aggregate = "mean",
        net_arch: Sequence[int] = (128, 128),
        latent_dim: int = 10,
        learns_from: Teacher = "own",
    ) -> None:
        super().__init__()
        check_choice("modelled", modelled, Modelled)
        check_choice("aggregate", aggregate, Aggregate)
        check_choice("learns_from", learns_from, Teacher)
        check_layers("net_arch", net_arch)
        check_least("latent_dim", latent_dim, 1)
        self._aggregate = aggregate
        self.learns_from = learns_from
        self.belief_dim = latent_dim + 1
        self.variables = Variables(observation_dim, action_dim, "both", condition_on_next=True)
        self.embed = MLP(2 * observation_dim + action_dim + 1, EMBEDDING_DIM, net_arch)
        self.rho = MLP(EMBEDDING_DIM, latent_dim, (EMBEDDING_DIM,))
        self.decoder: Decoder | None = None
        if learns_from == "own":
            self.decoder = Decoder(self.variables, modelled, self.belief_dim, DECODER, n_numbers=2)

    def empty(self, batch_shape: tuple[int, ...] = ()) -> EmbeddingMemory:
        total = next(self.parameters()).new_zeros(*batch_shape, EMBEDDING_DIM)
        return EmbeddingMemory(total[..., :1], total)

    def absorb(self, memory: EmbeddingMemory, transitions: Transitions) -> EmbeddingMemory:
        return EmbeddingMemory(memory.n + 1, memory.total + self._embeddings(transitions))

    def prefixes(self, transitions: Transitions, weights: Tensor | None = None) -> EmbeddingMemory:
        embeddings = self._embeddings(transitions.blanked(weights))
        counts = th.ones_like(embeddings[..., :1]) if weights is None else weights.unsqueeze(-1)
        before = EmbeddingMemory(counts, counts * embeddings)
        return map_memory(lambda summands: F.pad(summands.cumsum(dim=-2), (0, 0, 1, 0)), before)

    def belief(self, memory: EmbeddingMemory) -> Tensor:
        by = memory.n.clamp(min=1) if self._aggregate == "mean" else SUM_UNIT
        return th.cat([self.rho(memory.total / by), memory.n.log1p()], dim=-1)

    def count(self, memory: EmbeddingMemory) -> Tensor:
        return memory.n

    def loss(self, sequences: TaskSequences) -> Loss | None:
        """Return the loss above; None where others teach it. In training mode, move the running statistics too."""
        transitions, _, weights = sequences
        if self.training:
            self.variables.update(transitions, weights)
        if self.decoder is None:
            return None
        weights = th.ones_like(transitions.rewards[..., 0]) if weights is None else weights
        drawn = draw(weights)
        code = drawn.known(self.belief(self.prefixes(transitions, weights)))
        code = code[:, :, None].expand(*drawn.targets.shape, -1)
        values = map_memory(drawn.wanted, self.variables(transitions.blanked(weights)))
        nats = drawn.mean(th.stack([_log_density(told, y) for told, y in self.decoder(code, values)]).sum(dim=0))
        return Loss(-nats, {"nats": nats.detach()})

    def _embeddings(self, transitions: Transitions) -> Tensor:
        """Embed transitions: (..., dim) -> (..., 64)"""
        values = self.variables(transitions)
        embeddings: Tensor = self.embed(th.cat([values.here, values.y], dim=-1))
        return embeddings


def _log_density(told: Tensor, y: Tensor) -> Tensor:
    """Return log N(y), in nats, from mean and raw scale: (..., 2, dim), (..., dim) -> (...)"""
    mean, raw = told.unbind(dim=-2)
    log_densities: Tensor = Normal(mean, 0.1 + 0.9 * F.softplus(raw)).log_prob(y)
    return log_densities.sum(dim=-1)
