"""SB3's critics and action distribution without work whose result is thrown away. The numbers stay the same."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, Self

import torch as th
from stable_baselines3.common.distributions import SquashedDiagGaussianDistribution
from stable_baselines3.common.policies import ContinuousCritic
from torch import Tensor, nn
from torch.distributions import Normal


class LeanCritic(nn.Module):
    """Computes no gradients of its weights where an action needs one, which is where the actor learns. A mixin.

    SB3 differentiates the actor's loss by the critics' weights too, and throws that gradient away before the critics
    learn. What arrives at the actions and the observations is the same to the bit.
    """

    def forward(self, obs: Tensor, actions: Tensor) -> Any:
        with self._constant_if_acted_on(actions):
            return super().forward(obs, actions)  # of the critic it is mixed into

    def _constant_if_acted_on(self, actions: Tensor) -> Any:
        return _constant(self) if actions.requires_grad and th.is_grad_enabled() else nullcontext()


class LeanContinuousCritic(LeanCritic, ContinuousCritic):
    """The critics of SAC and TD3."""

    def q1_forward(self, obs: Tensor, actions: Tensor) -> Tensor:
        with self._constant_if_acted_on(actions):
            return super().q1_forward(obs, actions)


@contextmanager
def _constant(module: nn.Module) -> Iterator[None]:
    """Take the weights for constants in what is computed meanwhile."""
    learned = [parameter for parameter in module.parameters() if parameter.requires_grad]
    for parameter in learned:
        parameter.requires_grad_(False)
    try:
        yield
    finally:
        for parameter in learned:
            parameter.requires_grad_(True)


class LeanSquashedGaussian(SquashedDiagGaussianDistribution):
    r"""Scores its own samples by the noise that made them, rather than by what comes back of it.

    .. math:: a = \tanh(\mu + \sigma \epsilon), \quad
        \log p(a) = -\sum_i \left[\tfrac12 \epsilon_i^2 + \ln \sigma_i + \tfrac12 \ln 2 \pi
        + \ln(1 - a_i^2 + \texttt{epsilon})\right]

    SB3 recovers the noise as (a' - mu) / sigma and differentiates by both, where everything cancels. Samples are the
    same to the bit, their log-densities to the rounding of float32. Nothing is validated, for which a GPU would wait:
    the policy finds actions that are not finite when they arrive on the host.
    """

    def proba_distribution(self, mean_actions: Tensor, log_std: Tensor) -> Self:
        self.distribution = Normal(mean_actions, log_std.exp(), validate_args=False)
        return self

    def log_prob_from_params(self, mean_actions: Tensor, log_std: Tensor) -> tuple[Tensor, Tensor]:
        self.proba_distribution(mean_actions, log_std)
        noise = th.randn_like(mean_actions)
        self.gaussian_actions = mean_actions + noise * self.distribution.scale
        actions = th.tanh(self.gaussian_actions)
        terms = 0.5 * noise.square() + log_std + th.log(1 - actions.square() + self.epsilon)
        return actions, -terms.sum(dim=1) - 0.5 * self.action_dim * math.log(2 * math.pi)
