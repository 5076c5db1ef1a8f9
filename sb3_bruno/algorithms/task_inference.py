"""The mixin that gives an off-policy actor-critic a task encoder: it changes the data, never the loop.

It owns the encoder's optimiser, carries the belief in rollouts, binds buffer and encoder, and trains the encoder
before each round of the actor-critic's own updates.
"""

from __future__ import annotations

import io
import pathlib
from collections.abc import Iterable
from typing import Any, ClassVar, TypeVar

import numpy as np
import torch as th
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, RolloutReturn, Schedule
from stable_baselines3.common.utils import FloatSchedule, update_learning_rate

from sb3_bruno.algorithms.beliefs import BeliefQueries
from sb3_bruno.algorithms.checks import (
    check_algorithm,
    check_buffer,
    check_task_infos,
    join_policy_kwargs,
    read_task_space,
    resolve_policy,
)
from sb3_bruno.algorithms.late_log import record_late
from sb3_bruno.algorithms.policies import DeviceState, TaskInferencePolicy
from sb3_bruno.buffers.extended_obs import CriticInput
from sb3_bruno.buffers.task_buffer import TaskReplayBuffer
from sb3_bruno.buffers.transfer import to_device, to_host
from sb3_bruno.encoders import BrunoEncoder, TaskEncoder

SelfTaskInference = TypeVar("SelfTaskInference", bound="TaskInference")


class TaskInference(BeliefQueries, OffPolicyAlgorithm):
    """Mixin for SB3's off-policy actor-critics.

    :param policy: "MlpPolicy" or "MultiInputPolicy" (the same here), or a ``TaskInferencePolicy``
    :param env: an env that ``sb3_bruno_envs.check_meta_env`` finds no fault with
    :param args: positional arguments of the algorithm that this is mixed into
    :param encoder_class: task encoder
    :param encoder_kwargs: its arguments beyond the dimensions
    :param encoder_learning_rate: learning rate of the encoder's Adam, may be a schedule
    :param encoder_batch_size: sequences per encoder update, of the replay buffer's ``sequence_length`` each
    :param encoder_update_ratio: encoder updates per actor-critic update, may be a fraction
    :param encoder_learning_starts: env steps before the first encoder update; None: ``learning_starts``. A smaller
        value trains the encoder while actions are still random
    :param critic_input: what critics read beside observation and action: "task", "belief" or "both"
    :param kwargs: keyword arguments of the algorithm that this is mixed into
    :raises ValueError: if an argument or the env cannot work, with what to do instead
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {}
    policy: TaskInferencePolicy
    replay_buffer: TaskReplayBuffer
    encoder: TaskEncoder

    def __init__(
        self,
        policy: str | type[TaskInferencePolicy],
        env: GymEnv | str,
        *args: Any,
        encoder_class: type[TaskEncoder] = BrunoEncoder,
        encoder_kwargs: dict[str, Any] | None = None,
        encoder_learning_rate: float | Schedule = 1e-3,
        encoder_batch_size: int = 16,
        encoder_update_ratio: float = 0.5,
        encoder_learning_starts: int | None = None,
        critic_input: CriticInput = "task",
        **kwargs: Any,
    ) -> None:
        self.encoder_learning_rate = encoder_learning_rate
        self.encoder_batch_size = encoder_batch_size
        self.encoder_update_ratio = encoder_update_ratio
        self.encoder_learning_starts = encoder_learning_starts
        self._n_encoder_updates = 0
        self._encoder_updates_due = 0.0
        self._belief_state: DeviceState | None = None
        self._next_belief_state: DeviceState | None = None
        inference = {"encoder_class": encoder_class, "encoder_kwargs": encoder_kwargs, "critic_input": critic_input}
        kwargs["policy_kwargs"] = join_policy_kwargs(kwargs.get("policy_kwargs"), inference)
        super().__init__(resolve_policy(policy, self.policy_aliases), env, *args, **kwargs)

    def _setup_model(self) -> None:
        check_algorithm(self, self.encoder_batch_size, self.encoder_update_ratio)
        if self.env is not None:
            self.task_space = read_task_space(self.env, getattr(self, "task_space", None))
        self.policy_kwargs["task_space"] = self.task_space
        self.replay_buffer_class = self.replay_buffer_class or TaskReplayBuffer
        super()._setup_model()
        self.encoder_lr_schedule = FloatSchedule(self.encoder_learning_rate)
        self.encoder_optimizer = th.optim.Adam(self.encoder.parameters(), lr=self.encoder_lr_schedule(1), fused=True)
        self.bind_buffer()
        if self._belief_state is not None:  # loaded, as the arrays that ``save`` made of it
            self._belief_state = to_device([np.asarray(one) for one in self._belief_state], self.device)

    def _create_aliases(self) -> None:
        super()._create_aliases()  # type: ignore[misc]  # of the algorithm that this is mixed into
        self.encoder = self.policy.encoder

    def bind_buffer(self) -> None:
        """Give the replay buffer the encoder that its samples are made with.

        :raises ValueError: if it cannot serve: ``check_buffer``
        """
        check_buffer(self.replay_buffer, self.n_envs, self.encoder)
        self.replay_buffer.set_encoder(self.encoder, self.policy.layout)

    # -- collecting ------------------------------------------------------------------------------------------

    def _setup_learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        reset_num_timesteps: bool = True,
        tb_log_name: str = "run",
        progress_bar: bool = False,
    ) -> tuple[int, BaseCallback]:
        self.bind_buffer()  # a copied or unpickled buffer has lost its encoder
        starts_anew = reset_num_timesteps or self._last_obs is None
        result = super()._setup_learn(total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar)
        if starts_anew:
            self._belief_state = None
            self.replay_buffer.episodes.cut()
            assert self.env is not None  # for mypy
            check_task_infos(self.env)
        return result

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """SB3's own choice of an action, made at the extended observation.

        The belief that goes with it is committed in ``_store_transition``: a callback may stop in between.
        """
        assert isinstance(self._last_obs, dict)  # for mypy
        env_observation = self._last_obs
        extended, self._next_belief_state = self.policy.extend(
            env_observation, self._belief_state, self._last_episode_starts
        )
        self._last_obs = extended  # type: ignore[assignment]  # a tensor, which predict takes as it is
        try:
            return super()._sample_action(learning_starts, action_noise, n_envs)
        finally:
            self._last_obs = env_observation

    def _store_transition(
        self,
        replay_buffer: ReplayBuffer,
        buffer_action: NDArray[Any],
        new_obs: NDArray[Any] | dict[str, NDArray[Any]],
        reward: NDArray[Any],
        dones: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        super()._store_transition(replay_buffer, buffer_action, new_obs, reward, dones, infos)
        self._belief_state = self._next_belief_state
        self._last_episode_starts = dones

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> RolloutReturn:
        """As in SB3; an encoder that starts before the actor-critic is trained here until that starts too.

        Stopped in the middle, by a callback or an error, the envs are a step ahead of what is stored: to learn on
        then begins new episodes.
        """
        continues = False
        try:
            rollout = super().collect_rollouts(*args, **kwargs)
            continues = rollout.continue_training
        finally:
            if not continues:
                self._last_obs = None
        before_actor = self.num_timesteps <= self.learning_starts
        if continues and before_actor and self._encoder_has_started():
            gradient_steps = self.gradient_steps if self.gradient_steps >= 0 else rollout.episode_timesteps
            self._train_encoder(gradient_steps)
        return rollout

    # -- training --------------------------------------------------------------------------------------------

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Update the encoder, then the actor-critic as SB3 does, on beliefs of the encoder as it is now."""
        if self._encoder_has_started():
            self._train_encoder(gradient_steps)
        self.replay_buffer.forget_beliefs()
        super().train(gradient_steps, batch_size)

    def _encoder_has_started(self) -> bool:
        starts = self.learning_starts if self.encoder_learning_starts is None else self.encoder_learning_starts
        return self.num_timesteps > starts

    def _train_encoder(self, gradient_steps: int) -> None:
        """Make the updates due, ``encoder_update_ratio`` per actor-critic update: fractions add up over calls."""
        self._encoder_updates_due += self.encoder_update_ratio * gradient_steps
        n_updates = int(self._encoder_updates_due)
        self._encoder_updates_due -= n_updates
        if n_updates == 0:
            return
        learning_rate = self.encoder_lr_schedule(self._current_progress_remaining)
        update_learning_rate(self.encoder_optimizer, learning_rate)
        self.encoder.train()
        bounds = th.stack([self._update_encoder() for _ in range(n_updates)])
        self.encoder.eval()
        self._n_encoder_updates += n_updates
        self._recall_running_episodes()
        self.logger.record("encoder/learning_rate", learning_rate)
        self.logger.record("encoder/n_updates", self._n_encoder_updates, exclude="tensorboard")
        scalars = {"bound_nats": bounds.mean(), **self.encoder.diagnostics()}
        record_late(self.logger, {f"encoder/{name}": value for name, value in scalars.items()})

    def _update_encoder(self) -> th.Tensor:
        """One step up the bound. Returns it, a scalar in nats per transition, left on its device."""
        sequences = self.replay_buffer.sample_sequences(self.encoder_batch_size, self._vec_normalize_env)
        bound = self.encoder.bound(sequences)
        self.encoder_optimizer.zero_grad()
        (-bound).backward()
        self.encoder_optimizer.step()
        return bound.detach()

    def _recall_running_episodes(self) -> None:
        """Encode the running episodes again, so that a carried belief never mixes an old encoder with a new.

        The newest transition of an episode is left out: the next observation brings it.
        """
        if self._belief_state is None:
            return
        slots, lengths = self.replay_buffer.episodes.running()
        transitions = self.replay_buffer.transitions(slots, self._vec_normalize_env)
        with th.no_grad():
            prefixes = self.encoder.prefixes(transitions, weights=self.replay_buffer.absorbed(slots))
            envs = th.arange(self.n_envs, device=self.device)
            known = th.as_tensor(np.maximum(lengths - 1, 0), device=self.device)
            statistics = tuple(one[envs, known] for one in prefixes)
            belief = self.encoder.posterior(statistics)
        self._belief_state = (*statistics, self._belief_state[-1])
        scalars = {"belief/mean_abs": belief.mean.abs().mean(), "belief/var": belief.variance.mean()}
        record_late(self.logger, scalars)

    # -- saving ----------------------------------------------------------------------------------------------

    def load_replay_buffer(self, path: str | pathlib.Path | io.BufferedIOBase, truncate_last_traj: bool = True) -> None:
        """As in SB3; ``truncate_last_traj`` begins new episodes, without it the buffer's own go on.

        :raises ValueError: if it cannot serve: ``check_buffer``
        """
        super().load_replay_buffer(path, truncate_last_traj)
        self.bind_buffer()
        if truncate_last_traj:
            self._last_obs = None

    def set_env(self, env: GymEnv, force_reset: bool = True) -> None:
        wrapped = self._wrap_env(env, self.verbose)
        read_task_space(wrapped, self.task_space)
        super().set_env(wrapped, force_reset)

    def save(
        self,
        path: str | pathlib.Path | io.BufferedIOBase,
        exclude: Iterable[str] | None = None,
        include: Iterable[str] | None = None,
    ) -> None:
        """As in SB3; the belief of a running episode is kept as arrays, which load on any device."""
        self.policy_kwargs["forget_threshold"] = self.policy.forget_threshold  # which may have been set since
        carried = self._belief_state
        self._belief_state = None if carried is None else to_host(carried)  # type: ignore[assignment]  # for now
        try:
            super().save(path, exclude, include)
        finally:
            self._belief_state = carried

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "encoder", "encoder_optimizer", "_next_belief_state"]

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        state_dicts, variables = super()._get_torch_save_params()
        return [*state_dicts, "encoder_optimizer"], variables

    def learn(
        self: SelfTaskInference,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 4,
        tb_log_name: str | None = None,
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> SelfTaskInference:
        """As in SB3; the TensorBoard run is named after the class unless ``tb_log_name`` names it."""
        return super().learn(
            total_timesteps,
            callback,
            log_interval,
            tb_log_name or type(self).__name__,
            reset_num_timesteps,
            progress_bar,
        )
