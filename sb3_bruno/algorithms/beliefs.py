"""What the agent believes, for people to read: beliefs and predictions in the env's own units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import torch as th
from gymnasium.spaces import Space, flatdim
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecNormalize
from torch.distributions import Distribution

from sb3_bruno.algorithms.carried import Carried, State
from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.reading import read_batch, read_numbers
from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno.algorithms.values import check_whole
from sb3_bruno.buffers.numbers import check_numbers
from sb3_bruno.buffers.observed import TransitionArrays, normalize, unnormalize
from sb3_bruno.encoders import (
    HasPosterior,
    InfersTask,
    Moments,
    Outcomes,
    Predicts,
    PredictsMoments,
    TaskEncoder,
    Transitions,
)
from sb3_bruno.encoders.abilities import check_ability
from sb3_bruno.encoders.base import AnyMemory
from sb3_bruno.encoders.task_readout import ListReadout


class TaskBelief(NamedTuple):
    """A belief over the hidden task.

    Attributes:
        posterior: p(theta | transitions), its mean of shape (..., latent_dim).
        memory: what the encoder keeps of the transitions.
    """

    posterior: Distribution
    memory: AnyMemory

    @property
    def mean(self) -> NDArray[np.float32]:
        """Mean of theta, shape (..., latent_dim)."""
        return np.asarray(self.posterior.mean.cpu().numpy())

    @property
    def var(self) -> NDArray[np.float32]:
        """Variance of theta, shape (..., latent_dim)."""
        return np.asarray(self.posterior.variance.cpu().numpy())


class AgentView:
    """Translates between the env's own units and what the agent observes: scaled actions, normalised observations.

    Args:
        policy: the policy, which knows the action's bounds and the encoder.
        vec_normalize: the VecNormalize of the training env, if there is one.
    """

    def __init__(self, policy: TaskInferencePolicy, vec_normalize: VecNormalize | None) -> None:
        self.policy = policy
        self.encoder = policy.encoder
        self.vec_normalize = vec_normalize

    def infer(self, transitions: Transitions) -> TaskBelief:
        """Compute the belief of a sequence of transitions, of shape (..., time, dim). Time 0 gives the prior."""
        return self._belief(self.remember(transitions))

    def carried(self, state: State) -> TaskBelief:
        """Read the belief in a state that ``predict`` returned, batch shape (n_envs,)."""
        return self._belief(self.remembered(state))

    def remember(self, transitions: Transitions) -> AnyMemory:
        """Compute what the encoder keeps of a sequence of transitions, of shape (..., time, dim)."""
        if not isinstance(transitions, tuple | list) or len(transitions) != len(Transitions._fields):
            raise ValueError(f"`transitions` is no `Transitions({', '.join(Transitions._fields)})`: give these four.")
        observed = self.observe(*transitions)
        _check_entries(dict(zip(Transitions._fields, transitions, strict=True)))
        if observed.rewards.ndim < 2:
            raise ValueError("`rewards` has shape (1,): give sequences, (..., time, 1), of time 1 for one transition.")
        with th.no_grad():
            memory: AnyMemory = self.encoder.last(observed)
            return memory

    def remembered(self, state: State) -> AnyMemory:
        """Read what the encoder keeps off a state that ``predict`` returned, batch shape (n_envs,)."""
        with th.no_grad():
            carried = Carried.unpack(state, self.encoder, self.policy.device)
            observation_dim = flatdim(self.policy.observation_space["observation"])
            if carried.observation.shape[1:] != (observation_dim,):
                raise ValueError(
                    f"`state` holds observations of shape {tuple(carried.observation.shape[1:])}, this model's have "
                    f"{(observation_dim,)}: pass back the state that its own `predict` returned."
                )
            return carried.memory

    def read_task(self, memory: AnyMemory, labels: TaskLabels) -> TaskEstimate:
        """Read the task off what the encoder keeps."""
        readout = self.policy.readout
        if readout is None:
            raise ValueError(
                "The agent has no read-out of the task: it was saved without one. `fit_readout` learns one from a "
                "replay buffer; new agents have one unless `task_readout=False`."
            )
        with th.no_grad():
            read = readout.read(self.encoder, memory)
        mean, std, probabilities = (None if told is None else told.cpu().numpy() for told in read)
        assert mean is not None and std is not None  # for mypy
        tasks = readout.tasks.cpu().numpy() if isinstance(readout, ListReadout) else None
        return TaskEstimate(mean, std, tasks, probabilities, labels)

    def outcomes(
        self,
        belief: TaskBelief,
        observations: ArrayLike,
        actions: ArrayLike,
        next_observations: ArrayLike | None,
        n_samples: int,
    ) -> Outcomes:
        """Draw samples of rewards and next observations after ``actions`` at ``observations``."""
        predictor: Predicts = check_ability(self.encoder, Predicts, "`predict_outcomes`")
        check_whole("n_samples", n_samples, 1)
        question = self._ask(belief, observations, actions, next_observations)
        with th.no_grad():
            return self._unnormalize(predictor.outcomes(*question, n_samples))

    def moments(
        self, belief: TaskBelief, observations: ArrayLike, actions: ArrayLike, next_observations: ArrayLike | None
    ) -> Moments:
        """Compute mean and standard deviation of rewards and next observations."""
        predictor: PredictsMoments = check_ability(self.encoder, PredictsMoments, "`predict_moments`")
        question = self._ask(belief, observations, actions, next_observations)
        with th.no_grad():
            mean, std = predictor.moments(*question)
        return Moments(self._unnormalize(mean), self._unnormalize_std(std))

    def _ask(
        self, belief: TaskBelief, observations: ArrayLike, actions: ArrayLike, next_observations: ArrayLike | None
    ) -> tuple[AnyMemory, th.Tensor, th.Tensor, th.Tensor | None]:
        """Show what may follow which belief as the agent observes it: memory, observations, actions, arrivals."""
        _check_belief(belief, self.encoder)
        arrivals = observations if next_observations is None else next_observations
        batch = tuple(belief.posterior.mean.shape[:-1])
        here = self.observe(observations, actions, np.zeros((*batch, 1)), arrivals, batch=batch)
        there = None if next_observations is None else here.next_observations
        return belief.memory, here.observations, here.actions, there

    def observe(
        self,
        observations: ArrayLike,
        actions: ArrayLike,
        rewards: ArrayLike,
        next_observations: ArrayLike,
        *,
        batch: tuple[int, ...] | None = None,
    ) -> Transitions:
        """Show transitions in the env's units as the agent observes them, (..., dim). NaN, such as padding, stays NaN.

        Args:
            observations: flat, (*batch, dim), or in the shape of their space.
            actions: likewise.
            rewards: (*batch, 1).
            next_observations: as observations.
            batch: the batch shape that all must have. None: that of most of them.

        Raises:
            ValueError: naming the array that has another shape.
        """
        seen, acted = _shape(self.policy.observation_space["observation"]), _shape(self.policy.action_space)
        names = ("observations", "actions", "rewards", "next_observations")
        arrays = dict(zip(names, (observations, actions, rewards, next_observations), strict=True))
        shaped = read_batch(arrays, dict(zip(names, (seen, acted, (1,), seen), strict=True)), batch)
        batch = shaped["rewards"].shape[:-1]
        shaped["actions"] = self.policy.scale_action(shaped["actions"]).reshape(*batch, math.prod(acted))
        observed = normalize(TransitionArrays(**shaped), self.vec_normalize)
        flat = (array.reshape(*batch, math.prod(array.shape[len(batch) :])) for array in observed)
        return Transitions(*(th.as_tensor(array, dtype=th.float32, device=self.policy.device) for array in flat))

    def task_probabilities(
        self, belief: TaskBelief, tasks: ArrayLike, log_prior: ArrayLike | None
    ) -> NDArray[np.float32]:
        """Compute the posterior over candidate tasks."""
        encoder: InfersTask = check_ability(self.encoder, InfersTask, "`task_probabilities`")
        _check_belief(belief, self.encoder)
        candidates, task_dim = read_numbers("tasks", tasks), flatdim(self.policy.task_space)
        if candidates.ndim != 2 or candidates.shape[1] != task_dim or len(candidates) == 0:
            raise ValueError(f"`tasks` has shape {candidates.shape}: give candidates of shape (1 or more, {task_dim}).")
        log_weights = np.zeros(len(candidates), np.float32) if log_prior is None else _read_log_prior(log_prior)
        if log_weights.shape != (len(candidates),):
            raise ValueError(
                f"`log_prior` has shape {log_weights.shape}: give one for each task, {(len(candidates),)}."
            )
        _check_entries({"tasks": candidates})
        with th.no_grad():
            weights = encoder.log_task_likelihood(belief.memory, th.as_tensor(candidates, device=self.policy.device))
            weights = weights + th.as_tensor(log_weights).to(weights)
            return np.asarray(weights.softmax(dim=-1).float().cpu().numpy())

    def _belief(self, memory: AnyMemory) -> TaskBelief:
        encoder: HasPosterior = check_ability(self.encoder, HasPosterior, "A belief to read")
        with th.no_grad():
            return TaskBelief(encoder.posterior(memory), memory)

    def _unnormalize_std(self, std: Outcomes) -> Outcomes:
        """Scale standard deviations, without what is added to values: it may swallow all their digits."""
        if self.vec_normalize is None:
            return std
        far, near = (self._unnormalize(Outcomes(*(_multiple(part, by) for part in std))) for by in (1.0, 0.0))
        return Outcomes(*(None if part is None else part.float() for part in _each(th.sub, far, near)))

    def _unnormalize(self, samples: Outcomes) -> Outcomes:
        if self.vec_normalize is None:
            return samples
        shape = _shape(self.policy.observation_space["observation"])
        rewards = np.zeros(1) if samples.rewards is None else samples.rewards.cpu().numpy()
        arrivals = np.zeros(shape)
        if samples.next_observations is not None:
            arrivals = samples.next_observations.cpu().numpy()
            arrivals = arrivals.reshape(*arrivals.shape[:-1], *shape)
        own_rewards, own_arrivals = unnormalize(rewards, arrivals, self.vec_normalize)
        return Outcomes(_like(samples.rewards, own_rewards), _like(samples.next_observations, own_arrivals))


def _check_belief(belief: Any, encoder: TaskEncoder) -> None:
    """Refuse what is no belief, or one of an encoder that keeps another memory."""
    if not isinstance(belief, TaskBelief):
        raise TypeError(f"`belief={belief!r}` is no belief: give what `infer` or `belief` returned.")
    own = encoder.empty(tuple(belief.posterior.mean.shape[:-1]))
    reader: HasPosterior = check_ability(encoder, HasPosterior, "A belief to read")
    kept, needed = _kind(belief.memory, belief.posterior), _kind(own, reader.posterior(own))
    if kept != needed:
        raise ValueError(
            f"`belief` is of another model: it rests on {kept}, and this {type(encoder).__name__} keeps {needed}. Give "
            "what this model's own `infer` or `belief` returned."
        )


def _kind(memory: AnyMemory, posterior: Distribution) -> str:
    """Describe a belief by its classes and the shapes of its tensors."""
    shapes = [tuple(tensor.shape) for tensor in memory]
    return f"{type(memory).__name__} of shapes {shapes}, a {type(posterior).__name__}"


def _read_log_prior(log_prior: ArrayLike) -> NDArray[np.float32]:
    """Read logs of prior weights, which say of one task at least that it can be."""
    log_weights = read_numbers("log_prior", log_prior)
    if np.isnan(log_weights).any() or (log_weights == np.inf).any() or (log_weights == -np.inf).all():
        raise ValueError(
            f"`log_prior` is {log_prior!r}: NaN and inf are no weights, and -inf, of what cannot be, is not for all."
        )
    return log_weights


def _each(function: Callable[[th.Tensor, th.Tensor], th.Tensor], a: Outcomes, b: Outcomes) -> Outcomes:
    """Apply a function to rewards and next observations, as far as there are any."""
    pairs = zip(a, b, strict=True)
    return Outcomes(*(None if x is None or y is None else function(x, y) for x, y in pairs))


def _like(samples: th.Tensor | None, own: NDArray[Any]) -> th.Tensor | None:
    """The samples in the env's own units, in their own shape; None where there are none."""
    return None if samples is None else th.as_tensor(own, dtype=samples.dtype).reshape(samples.shape)


def _multiple(samples: th.Tensor | None, factor: float) -> th.Tensor | None:
    """A multiple of the samples in float64; None where there are none."""
    return None if samples is None else factor * samples.double()


def check_question(observations: ArrayLike, actions: ArrayLike, next_observations: ArrayLike | None) -> None:
    """Refuse numbers that are not finite, of arrays whose shapes are right."""
    given = {"observations": observations, "actions": actions, "next_observations": next_observations}
    _check_entries({name: array for name, array in given.items() if array is not None})


def _check_entries(arrays: Mapping[str, ArrayLike]) -> None:
    """Refuse numbers that are not finite, naming the array and the place."""
    given = {name: np.asarray(array, dtype=np.float32) for name, array in arrays.items()}
    check_numbers(given, lambda index: f"at index {list(index)}")


def _shape(space: Space[Any]) -> tuple[int, ...]:
    assert space.shape is not None  # of a Box, for mypy
    return space.shape
