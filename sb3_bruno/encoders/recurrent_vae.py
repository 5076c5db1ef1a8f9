r"""VariBAD: a GRU infers a latent variable from which the rewards or changes of the whole episode can be predicted.

Reference: Zintgraf et al., VariBAD: A Very Good Method for Bayes-Adaptive Deep RL via Meta-Learning (2020, arXiv
1910.08348). Off-policy, as in BOReL's online part (Dorfman, Shenfeld and Tamar, 2021, arXiv 2008.02598).

.. math:: q_t(m) = q(m \mid \tau_{0:t}) = N(\mu(h_t), \text{diag } \sigma^2(h_t)), \quad h_t = \text{GRU}(h_{t-1},
    \tau_t)

.. math:: L = \text{mean}_t \big[ \text{mean}_i\, \| y_i - \hat y(m_t, x_i) \|^2 + \beta\, KL(q_t, q_{t-1}) \big],
    \quad m_t \sim q_t, \quad q_{-1} = N(0, I)

i goes over all transitions of the episode, before and after t. y is the standardised reward given x = (s, a, s'), the
mean squared over the standardised entries of s' - s given x = (s, a), or the sum of both. Read from the authors' code,
with its weights brought to this unit: its KL is summed over episodes while its reconstruction is averaged, so its
weights are between 0.0025 and 0.2 here, 0.02 on the cheetahs.

Deviations from the authors' code:

- SAC and other off-policy algorithms instead of PPO; whole replayed episodes, encoded anew at each sample.
- Targets and inputs are standardised by running statistics, so the KL's weight does not depend on the rewards' scale.
- The network reads (s, a, r, s' - s) by one layer, there (a, r, s') by a layer each, and the decoders read their inputs
  as they are. Sizes: a GRU of 64, there 128.
- Of each episode 16 prefixes are decoded, and 32 transitions from each; the KL is averaged over all prefixes.
- Gradients flow back through whole episodes, there through 50 steps on the cheetahs.
- (mu, log sigma^2) is appended to the observation; there it passes a layer first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypedDict

import torch as th
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence
from torch.nn import functional as F

from sb3_bruno.encoders.base import Loss, TaskSequences, Teacher, map_memory
from sb3_bruno.encoders.choices import check_choice, check_least
from sb3_bruno.encoders.decoder import Decoder
from sb3_bruno.encoders.draws import draw
from sb3_bruno.encoders.recurrent import RecurrentMemory
from sb3_bruno.encoders.standard_recurrent import StandardRecurrent
from sb3_bruno.encoders.variables import Modelled

DECODER = (64, 32)
"""Widths of the decoders' hidden layers, the authors'."""


class VaeArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``RecurrentVae``."""

    modelled: Modelled
    hidden_size: int
    latent_dim: int
    kl_weight: float
    learns_from: Teacher


class RecurrentVae(StandardRecurrent):
    """Creates VariBAD's task encoder. Actor and critics see the mean and the log-variance of its latent variable.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        modelled: what the latent variable must predict: ``"rewards"``, ``"next_observations"`` or ``"both"``.
        hidden_size: size of the GRU's state.
        latent_dim: size of the latent variable.
        kl_weight: beta, of the KL between successive posteriors, per squared error of a standardised value.
        learns_from: ``"own"``, the loss above. ``"critic"`` or ``"actor"``: that one's loss and the KL, without a
            decoder: the authors' ablation.

    Raises:
        ValueError: if an argument is none of the above, or a number is out of range.
    """

    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {
        "hidden_size": (64, 128),
        "latent_dim": (5, 10),
        "kl_weight": (1e-3, 0.02, 0.1, 1.0),
    }

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        modelled: Modelled = "both",
        hidden_size: int = 64,
        latent_dim: int = 5,
        kl_weight: float = 0.02,
        learns_from: Teacher = "own",
    ) -> None:
        check_choice("modelled", modelled, Modelled)
        check_choice("learns_from", learns_from, Teacher)
        check_least("latent_dim", latent_dim, 1)
        check_least("kl_weight", kl_weight, 0)
        super().__init__(observation_dim, action_dim, "gru", hidden_size)
        self.learns_from = learns_from
        self.kl_weight = kl_weight
        self.belief_dim = 2 * latent_dim
        self.moments = nn.Linear(hidden_size, 2 * latent_dim)
        self.decoder: Decoder | None = None
        if learns_from == "own":
            self.decoder = Decoder(self.variables, modelled, latent_dim, DECODER)

    def belief(self, memory: RecurrentMemory) -> Tensor:
        """Return (mu, log sigma^2), shape (..., 2 latent_dim)."""
        moments: Tensor = self.moments(memory.hidden)
        return moments

    def posterior(self, memory: RecurrentMemory) -> Normal:
        """q(m | transitions absorbed), batch shape (..., latent_dim)."""
        mean, log_var = self.belief(memory).chunk(2, dim=-1)
        return Normal(mean, (0.5 * log_var).exp())

    def loss(self, sequences: TaskSequences) -> Loss:
        """Return the loss above; without a decoder the KL alone. In training mode, move the running statistics too."""
        transitions, _, weights = sequences
        if self.training:
            self.variables.update(transitions, weights)
        weights = th.ones_like(transitions.rewards[..., 0]) if weights is None else weights
        posterior = self.posterior(self.prefixes(transitions, weights))
        kl = _mean_kl(posterior, weights)
        scalars = {"kl_nats": kl.detach()}
        if self.decoder is None:
            return Loss(self.kl_weight * kl, scalars)
        drawn = draw(weights)
        code = drawn.known(posterior.rsample())[:, :, None].expand(*drawn.targets.shape, -1)
        values = map_memory(drawn.wanted, self.variables(transitions.blanked(weights)))
        errors = [(told[..., 0, :] - y).square().mean(dim=-1) for told, y in self.decoder(code, values)]
        error = drawn.mean(th.stack(errors).sum(dim=0))
        return Loss(error + self.kl_weight * kl, {**scalars, "squared_error": error.detach()})


def _mean_kl(posteriors: Normal, weights: Tensor) -> Tensor:
    """Return KL(q_t, q_{t-1}) in nats, averaged over the prefixes that count of each sequence, then over sequences.

    Args:
        posteriors: of each prefix, batch shape (batch, time + 1, latent_dim).
        weights: shape (batch, time).
    """
    means, stds = posteriors.mean[:, :-1], posteriors.stddev[:, :-1]
    before = Normal(F.pad(means, (0, 0, 1, 0)), F.pad(stds, (0, 0, 1, 0), value=1.0))
    counts = F.pad(weights, (1, 0), value=1.0)
    kl = kl_divergence(posteriors, before).sum(dim=-1)
    return ((counts * kl).sum(dim=1) / counts.sum(dim=1)).mean()
