"""Policies whose actor acts on observation and belief, and whose belief travels through ``predict``.

The policy owns the task encoder, so that device, ``state_dict``, ``save`` and ``load`` take it along.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, FlattenExtractor
from stable_baselines3.common.type_aliases import PyTorchObs, Schedule
from stable_baselines3.common.utils import is_vectorized_observation

from sb3_bruno.algorithms.forgetting import Suspicion, absorb_or_forget, no_suspicion, where
from sb3_bruno.buffers.extended_obs import CriticInput, ExtendedObs, SliceExtractor
from sb3_bruno.buffers.transfer import to_device, to_host
from sb3_bruno.encoders import BrunoEncoder, Statistics, TaskEncoder, Transitions

Observation = NDArray[Any] | th.Tensor | dict[str, NDArray[Any]]
State = tuple[NDArray[Any], ...]
"""What an agent carries from step to step: the encoder's statistics, the observation it came from and, where it may
forget, the evidence of a switch and the statistics since that began. Every array has shape (n_envs, anything)."""
DeviceState = tuple[th.Tensor, ...]
"""The same as tensors on the policy's device, as a rollout carries it."""


class TaskInferencePolicy(BasePolicy):
    """Mixin for SB3's actor-critic policies.

    :param observation_space: the Dict of ``TransitionObservation``
    :param action_space: action space
    :param lr_schedule: learning rate schedule of actor and critics
    :param task_space: the space of task vectors, which critics may read
    :param encoder_class: task encoder, built from ``(observation_dim, action_dim, **encoder_kwargs)``
    :param encoder_kwargs: further arguments of the encoder
    :param critic_input: what critics read beside observation and action: "task", "belief" or "both"
    :param forget_threshold: nats of evidence for another task at which ``predict`` forgets what came before; None:
        never. For tasks that switch in mid-episode; may be set on a trained policy. Training never forgets
    :param kwargs: arguments of the policy that this is mixed into
    :raises ValueError: if a features extractor is asked for, which the extended observation would drop silently, or
        ``forget_threshold`` is not positive
    """

    observation_space: spaces.Dict
    encoder: TaskEncoder
    actor_kwargs: dict[str, Any]
    critic_kwargs: dict[str, Any]

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Box,
        lr_schedule: Schedule,
        *,
        task_space: spaces.Box,
        encoder_class: type[TaskEncoder] = BrunoEncoder,
        encoder_kwargs: dict[str, Any] | None = None,
        critic_input: CriticInput = "task",
        forget_threshold: float | None = None,
        **kwargs: Any,
    ) -> None:
        if kwargs.get("features_extractor_class", FlattenExtractor) is not FlattenExtractor:
            raise ValueError(
                f"`features_extractor_class={kwargs['features_extractor_class']!r}` is not supported: actor and "
                "critics read slices of a flat vector. Extract features in an observation wrapper instead."
            )
        if kwargs.get("features_extractor_kwargs"):
            raise ValueError("`features_extractor_kwargs` is not supported: there is no features extractor to use it.")
        if kwargs.get("share_features_extractor"):
            raise ValueError("`share_features_extractor=True` is not supported: actor and critics read other slices.")
        self.task_space = task_space
        self.encoder_class = encoder_class
        self.encoder_kwargs = dict(encoder_kwargs or {})
        self.critic_input = critic_input
        self.forget_threshold = forget_threshold
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    @property
    def forget_threshold(self) -> float | None:
        """Nats of evidence for another task at which ``predict`` forgets what came before; None: never."""
        return self._forget_threshold

    @forget_threshold.setter
    def forget_threshold(self, nats: float | None) -> None:
        if nats is not None and not nats > 0:
            raise ValueError(f"`forget_threshold` must be positive nats, got {nats}: None never forgets.")
        self._forget_threshold = nats

    def _build(self, lr_schedule: Schedule) -> None:
        observation_dim = spaces.flatdim(self.observation_space["observation"])
        encoder = self.encoder_class(observation_dim, spaces.flatdim(self.action_space), **self.encoder_kwargs)
        self._n_statistics = len(encoder.empty())
        self.layout = ExtendedObs(observation_dim, encoder.belief_dim, spaces.flatdim(self.task_space))
        for net_kwargs in (self.actor_kwargs, self.critic_kwargs):
            net_kwargs["observation_space"] = self.layout.space
        super()._build(lr_schedule)  # type: ignore[misc]  # of the policy it is mixed into
        # After the actor: SB3 looks for a policy's device at its first parameter, four times in a rollout's step.
        self.encoder = encoder.eval()  # but for its own updates

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        extractor = SliceExtractor(self.layout.space, self.layout.actor_slices)
        return super().make_actor(extractor)  # type: ignore[misc]  # of the policy it is mixed into

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        extractor = SliceExtractor(self.layout.space, self.layout.critic_slices(self.critic_input))
        return super().make_critic(extractor)  # type: ignore[misc]  # likewise

    def _get_constructor_parameters(self) -> dict[str, Any]:
        data = super()._get_constructor_parameters()
        data.update(
            task_space=self.task_space,
            encoder_class=self.encoder_class,
            encoder_kwargs=self.encoder_kwargs,
            critic_input=self.critic_input,
            forget_threshold=self.forget_threshold,
        )
        return data

    # -- acting ----------------------------------------------------------------------------------------------

    def predict(
        self,
        observation: Observation,
        state: State | None = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], State | None]:
        """As SB3's recurrent policies: pass back the ``state`` that the last call returned.

        :param observation: what ``TransitionObservation`` returns, or a batch of it; an extended observation
            (an array or tensor, as in the replay buffer) is acted on as it is
        :param state: the belief so far; None is the prior
        :param episode_start: where True, shape (n_envs,), the belief starts again from the prior
        :param deterministic: the actor's mode instead of a sample
        :return: the actions, and the state after this observation
        """
        if not isinstance(observation, dict):
            return super().predict(observation, state, episode_start, deterministic)  # type: ignore[arg-type]  # as it is
        carried = None if state is None else to_device(state, self.device)
        extended, carried = self.extend(observation, carried, episode_start, self.forget_threshold)
        actions, _ = super().predict(extended, deterministic=deterministic)  # type: ignore[arg-type]  # likewise
        return actions, to_host(carried)

    @th.inference_mode()
    def extend(
        self,
        observation: dict[str, NDArray[Any]],
        state: DeviceState | None = None,
        episode_start: NDArray[Any] | None = None,
        forget_threshold: float | None = None,
    ) -> tuple[th.Tensor, DeviceState]:
        """Absorb the transition that led to ``observation`` and lay out the extended observation.

        The Dict's own ``episode_start`` says that no transition led here; the argument says that the belief
        starts again. All that comes from the host goes to the device in one transfer, and nothing comes back.
        Without a ``forget_threshold`` nothing is forgotten: so it is in rollouts of training, as in their replay.

        :return: the extended observation, shape (n_envs, dim) or (dim,) as ``observation`` was, and the next state
        """
        vectorized = is_vectorized_observation(observation["observation"], self.observation_space["observation"])
        n_envs = len(observation["observation"]) if vectorized else 1
        fresh = np.zeros(n_envs, dtype=bool)
        if episode_start is not None:
            fresh = np.asarray(episode_start, dtype=bool).reshape(n_envs)
        began = np.asarray(observation["episode_start"]).reshape(n_envs) > 0  # also if VecNormalize has centred it
        if state is None:
            if not began.all():
                warnings.warn(
                    "`predict` was called in mid-episode without `state`, so the agent acts on its prior: pass back "
                    "the state that the last call returned.",
                    stacklevel=4,
                )
            fresh = np.ones_like(began)
        began = began | fresh
        parts = [observation["observation"], observation["action"], observation["reward"], fresh, began]
        here, action, reward, fresh_column, began_column = to_device(
            [np.asarray(one).reshape(n_envs, -1) for one in parts], self.device
        )
        nothing = self._no_memory(n_envs, forget_threshold)
        *carried, before = (*nothing, here) if state is None else state
        # What a call that forgets carries beside the statistics begins here, and ends, if others were before or after.
        memory = (*carried[: len(nothing)], *nothing[len(carried) :])
        memory = where(fresh_column > 0, nothing, memory) if fresh.any() else memory
        absorbed = self._absorb(memory, Transitions(before, action, reward, here), forget_threshold)
        memory = where(began_column > 0, memory, absorbed) if began.any() else absorbed
        extended = self.layout.join(here, self.encoder.belief(self.statistics(memory)))
        return (extended if vectorized else extended[0]), (*memory, here)

    def statistics(self, state: DeviceState) -> Statistics:
        """What the encoder keeps, which comes first in a state."""
        return state[: self._n_statistics]

    def _no_memory(self, n_envs: int, forget_threshold: float | None) -> DeviceState:
        """What is carried beside the observation, at an episode's start."""
        if forget_threshold is None:
            return self.encoder.empty((n_envs,))
        evidence, recent = no_suspicion(self.encoder, (n_envs,))
        return (*self.encoder.empty((n_envs,)), *recent, evidence)

    def _absorb(self, memory: DeviceState, transitions: Transitions, forget_threshold: float | None) -> DeviceState:
        statistics = self.statistics(memory)
        if forget_threshold is None:
            return self.encoder.absorb(statistics, transitions)
        *recent, evidence = memory[len(statistics) :]
        suspicion = Suspicion(evidence, tuple(recent))
        statistics, suspicion = absorb_or_forget(self.encoder, statistics, suspicion, transitions, forget_threshold)
        return (*statistics, *suspicion.recent, suspicion.evidence)

    def set_training_mode(self, mode: bool) -> None:
        """As SB3; where nothing changes nothing is done, for SB3 asks twice in every step of a rollout."""
        if mode != self.training:
            super().set_training_mode(mode)

    def obs_to_tensor(self, observation: Observation) -> tuple[PyTorchObs, bool]:
        """Also of an extended observation, shape (n_envs, dim) or (dim,).

        :raises ValueError: if an array is not an extended observation
        """
        if isinstance(observation, dict):
            return super().obs_to_tensor(observation)
        array = observation if isinstance(observation, th.Tensor) else np.asarray(observation)
        if array.shape[-1:] != (self.layout.dim,):
            raise ValueError(
                f"Expected the Dict of `TransitionObservation` or an extended observation of size {self.layout.dim}, "
                f"got an array of shape {array.shape}: wrap the env in `sb3_bruno_envs.TransitionObservation`."
            )
        return th.as_tensor(array, device=self.device).reshape(-1, self.layout.dim), array.ndim > 1
