r"""PEARL's encoder: every transition tells a Gaussian over a latent task z, and the belief is the product of them all.

    (m_i, v_i) = MLP(s_i, a_i, r_i, s'_i)
    q(z | c) = N(z; 0, I) prod_i N(z; m_i, v_i), up to a constant
    P = 1 + sum_i 1 / v_i,  S = sum_i m_i / v_i,  mean = S / P,  var = 1 / P
    loss = (the critics' loss at the belief) + kl_weight KL(q(z | c) || N(0, I))

The order of the transitions does not matter, and two sums are all that is kept of them. The critics' loss teaches it.
Reference: Rakelly et al., Efficient Off-Policy Meta-Reinforcement Learning via Probabilistic Context Variables (2019,
arXiv 1903.08254), and its code. Deviations: ``docs/encoders.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import torch as th
from torch import Tensor, nn
from torch.distributions import Normal
from torch.nn import functional as F

from sb3_bruno.encoders.base import Loss, TaskEncoder, TaskSequences, Teacher, Transitions
from sb3_bruno.encoders.product_arguments import KL_WEIGHT, BeliefForm, check_together

LEAST_VAR = 1e-7  # there too


class ProductMemory(NamedTuple):
    """What a product of Gaussians keeps. Of what ``belief`` has no use for, the last dimension is 0.

    Attributes:
        precision: the sum of 1 / v_i, shape (..., latent_dim).
        shift: the sum of m_i / v_i, shape (..., latent_dim).
        noise: standard normal, of which z is made: shape (..., latent_dim).
        held: z of the running episode, where it is held: shape (..., latent_dim).
        episodes: how many episodes began, where z is held: shape (..., 1).
    """

    precision: Tensor
    shift: Tensor
    noise: Tensor
    held: Tensor
    episodes: Tensor


class ProductOfGaussians(TaskEncoder[ProductMemory]):
    """Creates PEARL's task encoder.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        latent_dim: dimension of z.
        net_arch: widths of the hidden layers.
        belief: what actor and critics read. ``"mean_var"``: mean and variance of z. ``"mean"``: its mean alone.
            ``"sample"``: z = mean + sqrt(var) noise, whose noise torch's generator draws where an episode begins (so
            also in ``predict(deterministic=True)``). None: ``"mean_var"``, or without the bottleneck ``"mean"``.
        exploration_episodes: of ``belief="sample"``, PEARL's own protocol: z is drawn where an episode of a ``Trial``
            begins, and held until the next; in so many first episodes from the prior, then from the posterior. None:
            z moves with the posterior.
        kl_weight: weight of the KL beside the loss of SB3's SAC.
        prior_factor: whether the prior is a factor of the product. None: True, or without the bottleneck False.
        information_bottleneck: False: the belief is the plain mean of learned features, and there is no KL.

    Raises:
        ValueError: if an argument is none of the above, or two do not go together.
    """

    learns_from: Teacher = "critic"
    learning_rate: ClassVar[float] = 3e-4
    max_grad_norm: float | None = 10.0
    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {
        "latent_dim": (3, 5, 10),
        "kl_weight": (1e-5, 1e-3, 0.03, 1.0),
    }

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        latent_dim: int = 5,
        net_arch: Sequence[int] = (128, 128),
        belief: BeliefForm | None = None,
        exploration_episodes: int | None = None,
        kl_weight: float = KL_WEIGHT,
        prior_factor: bool | None = None,
        information_bottleneck: bool = True,
    ) -> None:
        super().__init__()
        check_together(
            latent_dim=latent_dim,
            net_arch=net_arch,
            belief=belief,
            exploration_episodes=exploration_episodes,
            kl_weight=kl_weight,
            prior_factor=prior_factor,
            information_bottleneck=information_bottleneck,
        )
        self.kl_weight = kl_weight
        self.latent_dim = latent_dim
        self._belief: BeliefForm = belief or ("mean_var" if information_bottleneck else "mean")
        self.belief_dim = 2 * latent_dim if self._belief == "mean_var" else latent_dim
        self._exploration_episodes = exploration_episodes
        self.needs_trial = exploration_episodes is not None
        self._prior_precision = float(information_bottleneck if prior_factor is None else prior_factor)
        self._has_bottleneck = information_bottleneck
        self.network = _network(
            2 * observation_dim + action_dim + 1, latent_dim * (1 + information_bottleneck), net_arch
        )

    def empty(self, batch_shape: tuple[int, ...] = ()) -> ProductMemory:
        zeros = next(self.parameters()).new_zeros(*batch_shape, self.latent_dim)
        drawn = zeros if self._belief == "sample" else zeros[..., :0]
        held = drawn if self._exploration_episodes is not None else zeros[..., :0]
        return ProductMemory(zeros, zeros, drawn, held, held[..., :1])

    def absorb(self, memory: ProductMemory, transitions: Transitions) -> ProductMemory:
        precision, shift = self._factors(transitions)
        return memory._replace(precision=memory.precision + precision, shift=memory.shift + shift)

    def prefixes(self, transitions: Transitions, weights: Tensor | None = None) -> ProductMemory:
        counted = th.ones_like(transitions.rewards) if weights is None else weights.unsqueeze(-1)
        factors = self._factors(transitions.blanked(weights))
        precision, shift = (F.pad((counted * factor).cumsum(dim=-2), (0, 0, 1, 0)) for factor in factors)
        return self.empty(tuple(precision.shape[:-1]))._replace(precision=precision, shift=shift)

    def posterior(self, memory: ProductMemory) -> Normal:
        """q(z | transitions absorbed), batch shape (..., latent_dim)."""
        mean, var = self._moments(memory)
        return Normal(mean, var.sqrt())

    def belief(self, memory: ProductMemory) -> Tensor:
        mean, var = self._moments(memory)
        if self._belief == "mean":
            return mean
        if self._belief == "mean_var":
            return th.cat([mean, var], dim=-1)
        z = mean + var.sqrt() * memory.noise
        return z if self._exploration_episodes is None else th.where(memory.episodes > 0, memory.held, z)

    def redraw(self, memory: ProductMemory) -> ProductMemory:
        return memory._replace(noise=th.randn_like(memory.noise)) if self._belief == "sample" else memory

    def with_noise_of(self, memory: ProductMemory, other: ProductMemory) -> ProductMemory:
        return memory._replace(
            noise=other.noise.expand_as(memory.noise),
            held=other.held.expand_as(memory.held),
            episodes=other.episodes.expand_as(memory.episodes),
        )

    def start_episode(self, memory: ProductMemory) -> ProductMemory:
        """Draw z anew, from the prior as long as the agent explores."""
        memory = self.redraw(memory)
        if self._exploration_episodes is None:
            return memory
        mean, var = self._moments(memory)
        z = th.where(memory.episodes < self._exploration_episodes, memory.noise, mean + var.sqrt() * memory.noise)
        return memory._replace(held=z, episodes=memory.episodes + 1)

    def loss(self, sequences: TaskSequences) -> Loss | None:
        """Weigh the KL of the posteriors after 0, 1, ..., time - 1 transitions from the prior, in nats."""
        if not self._has_bottleneck:
            return None
        mean, var = self._moments(self.prefixes(sequences.transitions, sequences.weights))
        kl = 0.5 * (mean.square() + var - var.log() - 1).sum(dim=-1)[..., :-1]
        counted = th.ones_like(kl) if sequences.weights is None else (sequences.weights > 0).to(kl)
        kl = (counted * kl).sum() / counted.sum().clamp(min=1)
        return Loss(self.kl_weight * kl, {"kl_nats": kl.detach()})

    def _factors(self, transitions: Transitions) -> tuple[Tensor, Tensor]:
        """Compute what each transition (..., dim) adds to P and S, (..., latent_dim) each."""
        outputs = self.network(th.cat(transitions, dim=-1))
        if not self._has_bottleneck:
            return th.ones_like(outputs), outputs
        mean, spread = outputs.chunk(2, dim=-1)
        precision = 1 / F.softplus(spread).clamp(min=LEAST_VAR)
        return precision, mean * precision

    def _moments(self, memory: ProductMemory) -> tuple[Tensor, Tensor]:
        """Mean and variance of z, (..., latent_dim) each. Of no factors, those of the prior."""
        precision = memory.precision + self._prior_precision
        precision = th.where(precision > 0, precision, 1.0)
        return memory.shift / precision, 1 / precision


def _network(n_inputs: int, n_outputs: int, net_arch: Sequence[int]) -> nn.Sequential:
    """Make PEARL's network. The last layer and all biases begin as there: small means, variances of softplus(0)."""
    layers: list[nn.Module] = []
    for width in net_arch:
        hidden = nn.Linear(n_inputs, width)
        nn.init.constant_(hidden.bias, 0.1)
        layers += [hidden, nn.ReLU()]
        n_inputs = width
    last = nn.Linear(n_inputs, n_outputs)
    for parameter in last.parameters():
        nn.init.uniform_(parameter, -3e-3, 3e-3)
    return nn.Sequential(*layers, last)
