"""The paper's model: a flow maps y and noise, given x, to latents that are exchangeable whatever their x."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch as th
from torch import Tensor
from zuko.lazy import Flow

from sb3_bruno.encoders.abilities import Outcomes
from sb3_bruno.encoders.base import Transitions
from sb3_bruno.encoders.latents import LatentModel, Seen, check_arrives
from sb3_bruno.encoders.variables import Variables
from sb3_bruno.maths.exchangeable import ExchangeableGaussian
from sb3_bruno.maths.flow import ConditionalFlow


class ExchangeableModel(LatentModel):
    """Creates z = flow(y, noise | x), as many latents as y and the noise have dimensions.

    Args:
        variables: read y and x.
        process: makes the process of so many dimensions.
        extra_dims: dimensions of the noise that augments y (section 2.2 of the paper).
        flow_class: as ``ConditionalFlow`` takes it.
        flow_kwargs: likewise.
    """

    def __init__(
        self,
        variables: Variables,
        process: Callable[[int], ExchangeableGaussian],
        extra_dims: int,
        flow_class: str | Callable[..., Flow] | None,
        flow_kwargs: dict[str, Any] | None,
    ) -> None:
        super().__init__(variables)
        self.noise_dim = extra_dims
        self.latent_dim = variables.reward_dim + variables.change_dim + extra_dims
        self.flow = ConditionalFlow(self.latent_dim, variables.x_dim, flow_class, flow_kwargs)
        self.process = process(self.latent_dim)

    def see(self, transitions: Transitions, noise: Tensor) -> Seen:
        values = self.variables(transitions)
        z, log_det = self.flow(th.cat([values.y, noise], dim=-1), values.x)
        return Seen((), z, log_det + self.variables.log_det(values))

    def outcomes(self, memory: Any, transitions: Transitions, arrives: bool, n_samples: int) -> Outcomes:
        variables = self.variables
        check_arrives(arrives or not variables.there_dim)
        x = variables(transitions).x
        y = self.flow.inverse(self.process.sample(memory, n_samples), x.expand(n_samples, *x.shape))
        rewards, changes, _ = y.split([variables.reward_dim, variables.change_dim, self.noise_dim], dim=-1)
        return Outcomes(
            variables.rewards.inverse(rewards) if variables.reward_dim else None,
            transitions.observations + variables.changes.inverse(changes) if variables.change_dim else None,
        )
