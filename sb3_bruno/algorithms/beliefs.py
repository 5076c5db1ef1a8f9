"""What the agent believes, for people to read: beliefs and predictions in the env's own units."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch as th
from gymnasium.spaces import Space, flatdim
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecNormalize
from torch.distributions import Distribution

from sb3_bruno.algorithms.policies import State, TaskInferencePolicy
from sb3_bruno.encoders import Outcomes, Statistics, Transitions


class TaskBelief(NamedTuple):
    """A belief over the hidden task.

    :ivar posterior: p(theta | transitions), batch shape (..., latent_dim)
    :ivar statistics: what the encoder keeps of the transitions
    """

    posterior: Distribution
    statistics: Statistics

    @property
    def mean(self) -> NDArray[np.float32]:
        """Mean of theta, shape (..., latent_dim)."""
        return np.asarray(self.posterior.mean.cpu().numpy())

    @property
    def var(self) -> NDArray[np.float32]:
        """Variance of theta, shape (..., latent_dim)."""
        return np.asarray(self.posterior.variance.cpu().numpy())


class AgentView:
    """Between the env's own units and what the agent observes: scaled actions, normalised observations.

    :param policy: the policy, which knows the action's bounds and the encoder
    :param vec_normalize: the VecNormalize of the training env, if there is one
    """

    def __init__(self, policy: TaskInferencePolicy, vec_normalize: VecNormalize | None) -> None:
        self.policy = policy
        self.encoder = policy.encoder
        self.vec_normalize = vec_normalize

    def infer(self, transitions: Transitions) -> TaskBelief:
        """The belief of a set of transitions, whatever their order.

        :param transitions: arrays or tensors of shape (..., time, dim); no transitions (time 0) give the prior
        """
        observed = self.observe(*transitions)
        with th.no_grad():
            statistics = self.encoder.empty(observed.rewards.shape[:-2])
            if observed.rewards.shape[-2] > 0:  # torch cannot run a flow on nothing
                statistics = tuple(one[..., -1, :] for one in self.encoder.prefixes(observed))
            return TaskBelief(self.encoder.posterior(statistics), statistics)

    def carried(self, state: State) -> TaskBelief:
        """The belief in a state that ``predict`` returned, batch shape (n_envs,)."""
        statistics = self.policy.statistics(tuple(th.as_tensor(one, device=self.policy.device) for one in state))
        with th.no_grad():
            return TaskBelief(self.encoder.posterior(statistics), statistics)

    def outcomes(
        self,
        belief: TaskBelief,
        observations: ArrayLike,
        actions: ArrayLike,
        next_observations: ArrayLike | None,
        n_samples: int,
    ) -> Outcomes:
        """Samples of rewards and next observations after ``actions`` at ``observations``."""
        arrivals = observations if next_observations is None else next_observations
        here = self.observe(observations, actions, np.zeros((*belief.statistics[0].shape[:-1], 1)), arrivals)
        there = None if next_observations is None else here.next_observations
        with th.no_grad():
            samples = self.encoder.outcomes(belief.statistics, here.observations, here.actions, there, n_samples)
        return self._unnormalize(samples)

    def observe(
        self, observations: ArrayLike, actions: ArrayLike, rewards: ArrayLike, next_observations: ArrayLike
    ) -> Transitions:
        """Transitions in the env's units as the agent observes them, (..., dim).

        Rewards (..., 1); the others flat, (..., dim), or in the shape of their space.
        """
        batch = np.shape(rewards)[:-1]
        observation_shape = (*batch, *_shape(self.policy.observation_space["observation"]))
        action = np.asarray(actions, dtype=np.float32).reshape(*batch, *_shape(self.policy.action_space))
        arrival: Any = {
            "observation": np.asarray(next_observations, dtype=np.float32).reshape(observation_shape),
            "action": self.policy.scale_action(action).reshape(*batch, flatdim(self.policy.action_space)),
            "reward": np.asarray(rewards, dtype=np.float32),
            "episode_start": np.zeros_like(rewards, dtype=np.float32),
        }
        observation: Any = np.asarray(observations, dtype=np.float32).reshape(observation_shape)
        if self.vec_normalize is not None:
            observation = self.vec_normalize.normalize_obs({**arrival, "observation": observation})["observation"]
            arrival = self.vec_normalize.normalize_obs(arrival)
        parts = (observation, arrival["action"], arrival["reward"], arrival["observation"])
        flat = (one.reshape(*batch, math.prod(one.shape[len(batch) :])) for one in parts)
        return Transitions(*(th.as_tensor(one, dtype=th.float32, device=self.policy.device) for one in flat))

    def _unnormalize(self, samples: Outcomes) -> Outcomes:
        if self.vec_normalize is None:
            return samples
        modelled = {"reward": samples.rewards, "observation": samples.next_observations}
        shapes = {key: _shape(self.policy.observation_space[key]) for key in modelled}
        arrays: Any = {
            key: np.zeros(shapes[key]) if one is None else one.cpu().numpy().reshape(*one.shape[:-1], *shapes[key])
            for key, one in modelled.items()
        }
        arrays = self.vec_normalize.unnormalize_obs({**arrays, "action": np.zeros(1), "episode_start": np.zeros(1)})
        rewards, next_observations = (
            None if one is None else th.as_tensor(arrays[key], dtype=th.float32).reshape(one.shape)
            for key, one in modelled.items()
        )
        return Outcomes(rewards, next_observations)


def _shape(space: Space[Any]) -> tuple[int, ...]:
    assert space.shape is not None  # of a Box, for mypy
    return space.shape


class BeliefQueries:
    """Mixin for algorithms: what their agent believes and what it expects, in the env's own units.

    An agent that was trained with VecNormalize knows these only together with it, which SB3 saves apart: load the
    agent with ``env=VecNormalize.load(...)``.
    """

    policy: TaskInferencePolicy
    _vec_normalize_env: VecNormalize | None

    def infer(self, transitions: Transitions) -> TaskBelief:
        """The belief of any set of transitions, whatever their order.

        :param transitions: arrays or tensors (..., time, dim) in the env's own units, dim flat or the shape of the
            space; time 0 gives the prior
        """
        return self._view.infer(transitions)

    def belief(self, state: State) -> TaskBelief:
        """The belief that an agent carries in the ``state`` that ``predict`` returned, batch shape (n_envs,)."""
        return self._view.carried(state)

    def predict_outcomes(
        self,
        belief: TaskBelief,
        observations: ArrayLike,
        actions: ArrayLike,
        next_observations: ArrayLike | None = None,
        n_samples: int = 1_000,
    ) -> Outcomes:
        """Samples of rewards and next observations in the env's own units, given a belief.

        :param belief: from ``infer`` or ``belief``
        :param observations: shape (..., observation_dim), the batch shape of ``belief``
        :param actions: shape (..., action_dim), in the env's units
        :param next_observations: where the actions led, for an encoder with ``condition_on_next``
        :param n_samples: Monte Carlo samples, from which ``mean()`` and ``quantile(q)`` are taken
        """
        return self._view.outcomes(belief, observations, actions, next_observations, n_samples)

    @property
    def _view(self) -> AgentView:
        return AgentView(self.policy, self._vec_normalize_env)
