"""The model with a kernel: how each value of y depends on the task's weights follows from its x."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch as th
from torch import Tensor
from zuko.lazy import Flow

from sb3_bruno.encoders.abilities import Moments, Outcomes
from sb3_bruno.encoders.base import Transitions
from sb3_bruno.encoders.latents import LatentModel, Seen, check_arrives
from sb3_bruno.encoders.variables import Variables
from sb3_bruno.maths.features import FeatureNetwork
from sb3_bruno.maths.flow import ConditionalFlow
from sb3_bruno.maths.kernel_process import KernelGaussian
from sb3_bruno.maths.kernel_statistics import Features

_MeanAndStd = tuple[Tensor | None, Tensor | None]
N_NODES = 32
"""Points of the Gauss-Hermite quadrature that takes the moments of a reward through its flow."""


class KernelModel(LatentModel):
    r"""Creates z = b(x) + Phi(x) w + noise, with z = (flow(r | x), s' - s).

    The reward goes through a flow, for it need not be linear in any few features of the task: minus the distance to
    a goal is not, and its square is. The features of r see all of x, those of s' - s see (s, a) alone.

    Rewards depend on K weights, and next observations on K others. If they shared them, what the networks have not yet
    learned of next observations, which outnumber the reward and have little noise, would pass for evidence about the
    task and drown the reward's.

    Args:
        variables: read y and x.
        process: makes the process of so many weights.
        n_weights: K.
        net_arch: hidden layers of the networks of the features.
        flow_class: as ``ConditionalFlow`` takes it.
        flow_kwargs: likewise.

    Raises:
        ValueError: if the flow cannot map one value.
    """

    def __init__(
        self,
        variables: Variables,
        process: Callable[[int], KernelGaussian],
        n_weights: int,
        net_arch: Sequence[int],
        flow_class: str | Callable[..., Flow] | None,
        flow_kwargs: dict[str, Any] | None,
    ) -> None:
        super().__init__(variables)
        if flow_class in ("paper_maf", "reflected_maf"):
            raise ValueError(
                f"`flow_class={flow_class!r}` needs `process='gaussian'` and `extra_dims`: with a kernel, a flow maps "
                "the reward alone. Use 'spline', or None."
            )
        self.n_weights = n_weights
        self.latent_dim = n_weights * (bool(variables.reward_dim) + bool(variables.change_dim))
        self.process = process(self.latent_dim)
        if variables.reward_dim:
            self.flow = ConditionalFlow(1, variables.x_dim, flow_class, flow_kwargs)
            self.reward_features = FeatureNetwork(variables.x_dim, 1, n_weights, net_arch)
        if variables.change_dim:
            self.change_features = FeatureNetwork(variables.here_dim, variables.change_dim, n_weights, net_arch)

    def _of_reward(self, x: Tensor) -> Features:
        """Return the features of r, which needs the first K of all weights."""
        features: Features = self.reward_features(x)
        return features.padded(0, self.latent_dim - self.n_weights)

    def _of_change(self, here: Tensor) -> Features:
        """Return the features of s' - s, which needs the last K of all weights."""
        features: Features = self.change_features(here)
        return features.padded(self.latent_dim - self.n_weights, 0)

    def see(self, transitions: Transitions, noise: Tensor) -> Seen:
        values, variables = self.variables(transitions), self.variables
        z, features, log_det = [], [], variables.log_det(values)
        if variables.reward_dim:
            latents = self.flow(values.rewards, values.x)
            z, features, log_det = [latents.z], [self._of_reward(values.x)], log_det + latents.log_det
        if variables.change_dim:
            z.append(values.changes)
            features.append(self._of_change(values.here))
        return Seen((Features.join(features),), th.cat(z, dim=-1), log_det)

    def outcomes(self, memory: Any, transitions: Transitions, arrives: bool, n_samples: int) -> Outcomes:
        """Draw next observations first, where they are modelled; then rewards given these, or given the known ones."""
        variables, process = self.variables, self.process
        rewards = arrivals = None
        follows = variables.change_dim > 0 and not arrives  # rewards follow from what is drawn, one from each sample
        if variables.change_dim:
            values = variables(transitions)
            features = self._of_change(values.here)
            z = process.sample(memory, features, n_samples)
            arrivals = transitions.observations + variables.changes.inverse(z)
            memory = process.absorb(memory, features, z if follows else values.changes)
            if follows:
                expanded = Transitions(*(column.expand(n_samples, *column.shape) for column in transitions))
                transitions = expanded._replace(next_observations=arrivals)
        if variables.reward_dim:
            check_arrives(arrives or follows or not variables.there_dim)
            x = variables(transitions).x
            z = process.sample(memory, self._of_reward(x), 1 if follows else n_samples)
            rewards = variables.rewards.inverse(self.flow.inverse(z.squeeze(0) if follows else z, x))
        return Outcomes(rewards, arrivals)

    def moments(self, memory: Any, transitions: Transitions, arrives: bool) -> Moments:
        """Take next observations from the process in closed form, and rewards through the flow by quadrature.

        Next observations are those of an affine map, as it is within 10 standard deviations of the data. A Student-t
        predictive counts as the normal of its moments, where a flow follows.
        """
        variables, process = self.variables, self.process
        rewards: _MeanAndStd = (None, None)
        arrivals: _MeanAndStd = (None, None)
        if variables.change_dim:
            values = variables(transitions)
            features = self._of_change(values.here)
            mean, var = process.predictive_moments(memory, features)
            arrivals = (transitions.observations + variables.changes.inverse(mean), var.sqrt() * variables.changes.std)
            memory = process.absorb(memory, features, values.changes) if arrives else memory
        if variables.reward_dim and (arrives or not variables.there_dim):
            x = variables(transitions).x
            mean, var = process.predictive_moments(memory, self._of_reward(x))
            nodes, weights = (mean.new_tensor(column) for column in np.polynomial.hermite_e.hermegauss(N_NODES))
            at_nodes = (nodes.reshape(-1, *[1] * mean.ndim) * var.sqrt() + mean, x.expand(N_NODES, *x.shape))
            y = variables.rewards.inverse(self.flow.inverse(*at_nodes)).movedim(0, -1)
            weights = weights / weights.sum()
            expected = y @ weights
            rewards = (expected, ((y - expected.unsqueeze(-1)).square() @ weights).sqrt())
        return Moments(*(Outcomes(*column) for column in zip(rewards, arrivals, strict=True)))
