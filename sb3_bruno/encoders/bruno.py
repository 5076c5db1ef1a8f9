"""BRUNO: a conditional flow with an exchangeable Gaussian process in its latent space.

    y = (r, s', eps), x = (s, a), z = flow(y | x), theta ~ N(0, rho), z_i | theta ~ N(theta, v - rho)

or, where the reward alone is modelled, y = (r, eps) and x = (s, a, s')

so the transitions seen so far give an exact Gaussian belief over theta, whatever their order.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

import torch as th
from torch import Tensor
from torch.distributions import Normal
from zuko.lazy import Flow

from sb3_bruno.encoders.base import Outcomes, Statistics, TaskEncoder, Transitions
from sb3_bruno.exchangeable import ExchangeableGaussian
from sb3_bruno.exchangeable import Statistics as LatentStatistics
from sb3_bruno.flow import ConditionalFlow, Latents
from sb3_bruno.standardize import Standardize

NOISE_ENTROPY = 0.5 * math.log(2 * math.pi * math.e)
"""Entropy of one standard normal noise dimension, in nats."""


class BrunoEncoder(TaskEncoder):
    r"""Creates the BRUNO task encoder.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020), sections 2.1 to 2.3.

    :param observation_dim: dimension of the (flattened) observation s
    :param action_dim: dimension of the action a
    :param modelled: what y holds: ``"rewards"`` (tasks that differ in their rewards alone),
        ``"next_observations"`` (in their dynamics alone), or ``"both"``
    :param condition_on_next: whether x holds s' too, so that a reward that depends on where the action led tells of the
        task and not of the noise in between. Only where the reward alone is modelled; not in the paper
    :param extra_dims: noise dimensions that augment y (section 2.2). None: 4, as in the paper, where the reward
        is modelled alone, and 0 otherwise
    :param flow_class: builds any zuko flow from ``(features, context, **flow_kwargs)``, or names one of
        ``sb3_bruno.flow.FLOWS``: ``"paper_maf"``, or ``"reflected_maf"`` where what speaks for a task at one x speaks
        against it at another (a direction: the reward's sign turns with the velocity's)
    :param flow_kwargs: further arguments of ``flow_class``
    :param belief: what actor and critics see of the posterior: ``"mean_var"`` or ``"mean"``
    :raises ValueError: if ``modelled`` or ``belief`` is none of the above, or ``extra_dims`` is negative
    """

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        modelled: Literal["rewards", "next_observations", "both"] = "rewards",
        condition_on_next: bool = False,
        extra_dims: int | None = None,
        flow_class: str | Callable[..., Flow] = "paper_maf",
        flow_kwargs: dict[str, Any] | None = None,
        belief: Literal["mean_var", "mean"] = "mean_var",
    ) -> None:
        super().__init__()
        if modelled not in ("rewards", "next_observations", "both"):
            raise ValueError(f"`modelled` must be 'rewards', 'next_observations' or 'both', got {modelled!r}.")
        if belief not in ("mean_var", "mean"):
            raise ValueError(f"`belief` must be 'mean_var' or 'mean', got {belief!r}.")
        if condition_on_next and modelled != "rewards":
            raise ValueError(f"`condition_on_next=True` needs `modelled='rewards'`, got {modelled!r}: s' is modelled.")
        if extra_dims is None:
            extra_dims = 4 if modelled == "rewards" else 0
        if extra_dims < 0:
            raise ValueError(f"`extra_dims` must not be negative, got {extra_dims}.")
        self._reward_dim = 0 if modelled == "next_observations" else 1
        self._next_observation_dim = 0 if modelled == "rewards" else observation_dim
        self._condition_on_next = condition_on_next
        self._belief = belief
        self.noise_dim = extra_dims
        self.latent_dim = self._reward_dim + self._next_observation_dim + extra_dims
        self.belief_dim = 2 * self.latent_dim if belief == "mean_var" else self.latent_dim
        context_dim = observation_dim + action_dim + (observation_dim if condition_on_next else 0)
        self.standardize_x = Standardize(context_dim)
        self.standardize_y = Standardize(self.latent_dim - extra_dims)
        self.flow = ConditionalFlow(self.latent_dim, context_dim, flow_class, flow_kwargs)
        self.process = ExchangeableGaussian(self.latent_dim)

    def latents(self, transitions: Transitions, noise: Tensor | None = None) -> Tensor:
        """z = flow(y | x) of each transition, x and y standardised.

        Transitions (..., dim) and noise (..., noise_dim) -> (..., latent_dim)
        """
        return self.flow.latents(*self._flow_input(transitions, noise))

    def latents_and_log_det(self, transitions: Transitions, noise: Tensor | None = None) -> Latents:
        """The same, with the log-determinant of the whole map, shape (...)."""
        z, log_det = self.flow(*self._flow_input(transitions, noise))
        return Latents(z, log_det - self.standardize_y.std.log().sum())

    def _flow_input(self, transitions: Transitions, noise: Tensor | None) -> tuple[Tensor, Tensor]:
        """y with its noise, and x."""
        if noise is None:
            noise = transitions.rewards.new_zeros(*transitions.rewards.shape[:-1], self.noise_dim)
        y = self.standardize_y(self._y(transitions))
        return th.cat([y, noise], dim=-1), self.standardize_x(self._x(transitions))

    def _x(self, transitions: Transitions) -> Tensor:
        """What the flow is conditioned on: (s, a) or (s, a, s')."""
        observations, actions, _, next_observations = transitions
        return th.cat([observations, actions, *([next_observations] if self._condition_on_next else [])], dim=-1)

    def _y(self, transitions: Transitions) -> Tensor:
        """What is modelled, without the noise: r, s' or (r, s')."""
        parts = [transitions.rewards[..., : self._reward_dim]]
        return th.cat([*parts, transitions.next_observations[..., : self._next_observation_dim]], dim=-1)

    def empty(self, batch_shape: tuple[int, ...] = ()) -> Statistics:
        return self.process.empty(batch_shape)

    def absorb(self, statistics: Statistics, transitions: Transitions, noise: Tensor | None = None) -> Statistics:
        one_more = self.process.observe(self.latents(transitions, noise))
        return LatentStatistics(*statistics).merge(one_more)

    def prefixes(self, transitions: Transitions, noise: Tensor | None = None) -> Statistics:
        return self.process.prefixes(self.latents(transitions, noise))

    def posterior(self, statistics: Statistics) -> Normal:
        return self.process.posterior(LatentStatistics(*statistics))

    def belief(self, statistics: Statistics) -> Tensor:
        theta = self.posterior(statistics)
        return theta.mean if self._belief == "mean" else th.cat([theta.mean, theta.variance], dim=-1)

    def bound(self, transitions: Transitions) -> Tensor:
        r"""Eq. 4: every transition of a sequence under the predictive given its first k, the k included.

        .. math:: \frac{1}{T} \sum_t \log p(y_t, \epsilon_t \mid x_t, \tau_{1:k}) + H(\epsilon), \quad
            k \sim U\{T/4, \dots, 3T/4 - 1\} \text{ once per batch}

        The entropy H of the noise makes it a lower bound on log p(y | x, context), constant included.
        """
        if self.training:
            self.standardize_x.update(self._x(transitions))
            self.standardize_y.update(self._y(transitions))
        time = transitions.rewards.shape[-2]
        z, log_det = self.latents_and_log_det(transitions, self.draw_noise(transitions.rewards.shape[:-1]))
        k = int(th.randint(max(time // 4, 1), max(3 * time // 4, 2), ()))
        predictive = self.process.predictive(self.process.statistics(z[..., :k, :]))
        log_z = Normal(predictive.mean.unsqueeze(-2), predictive.stddev.unsqueeze(-2), False).log_prob(z)
        nats: Tensor = log_z.sum(dim=-1) + log_det + self.noise_dim * NOISE_ENTROPY
        return nats.mean()

    def outcomes(
        self,
        statistics: Statistics,
        observations: Tensor,
        actions: Tensor,
        next_observations: Tensor | None,
        n_samples: int,
    ) -> Outcomes:
        """Draw z from the predictive and invert the flow. Shapes (..., dim) -> (n_samples, ..., dim)"""
        given = [observations, actions]
        if self._condition_on_next:
            if next_observations is None:
                raise ValueError(
                    "`next_observations` is needed: with `condition_on_next=True` rewards are predicted given where "
                    "the action led. Pass it, or train with `condition_on_next=False`."
                )
            given.append(next_observations)
        z = self.process.predictive(LatentStatistics(*statistics)).sample(th.Size([n_samples]))
        x = self.standardize_x(th.cat(given, dim=-1)).expand(n_samples, *observations.shape[:-1], -1)
        y = self.standardize_y.inverse(self.flow.inverse(z, x)[..., : self.latent_dim - self.noise_dim])
        rewards, arrivals = y.split([self._reward_dim, self._next_observation_dim], dim=-1)
        return Outcomes(
            rewards if self._reward_dim else None,
            arrivals if self._next_observation_dim else None,
        )

    def diagnostics(self) -> dict[str, float]:
        correlation = self.process.cov / self.process.var
        return {
            "process_var_mean": self.process.var.mean().item(),
            "process_correlation_mean": correlation.mean().item(),
            "process_correlation_max": correlation.max().item(),
        }
