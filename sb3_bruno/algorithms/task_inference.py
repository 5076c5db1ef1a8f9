"""The mixin that gives an off-policy actor-critic a task encoder: it changes the data, never the loop.

It carries the belief in rollouts. ``encoder_training.py`` trains the encoder, and ``saving.py`` saves it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar, cast

import numpy as np
import torch as th
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, RolloutReturn, Schedule
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.algorithms import guards
from sb3_bruno.algorithms.arguments import check_names, join_policy_kwargs, resolve_policy
from sb3_bruno.algorithms.belief_queries import BeliefQueries
from sb3_bruno.algorithms.carried import Carried, State
from sb3_bruno.algorithms.checks import (
    check_algorithm,
    check_early_resets,
    check_encoder_arguments,
    check_task_infos,
    family_of,
    read_task_space,
    warn_of_missing_trial,
)
from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.policy_arguments import check_policy_kwargs
from sb3_bruno.algorithms.rehearsal import warn_of_task_without_effect
from sb3_bruno.algorithms.saving import Saving
from sb3_bruno.algorithms.task_estimate import TaskLabels
from sb3_bruno.algorithms.values import check_env, check_kinds, check_learning, check_values, warn_of_missing_gpu
from sb3_bruno.buffers import TaskReplayBuffer
from sb3_bruno.buffers.extended_obs import CriticInput
from sb3_bruno.buffers.observed import keep_flag
from sb3_bruno.encoders import TaskEncoder, find_encoder

ENOUGH_EPISODES = 10
"""Episodes of one step each, after which it is no accident."""

SelfTaskInference = TypeVar("SelfTaskInference", bound="TaskInference")


class TaskInference(BeliefQueries, Saving, OffPolicyAlgorithm):
    """Gives SB3's off-policy actor-critics an encoder that infers the task. A mixin, named before the algorithm.

    Args:
        policy: "MlpPolicy" or "MultiInputPolicy" (the same here), or a ``TaskInferencePolicy``.
        env: an env that ``sb3_bruno_envs.check_meta_env`` finds no fault with.
        *args: positional arguments of the algorithm that this is mixed into.
        encoder_class: task encoder, or its name in ``sb3_bruno.encoders.ENCODERS``. None: ``default_encoder``.
        encoder_kwargs: its arguments beyond the dimensions.
        encoder_learning_rate: learning rate of the encoder's Adam, may be a schedule. None: the encoder's own default.
        encoder_batch_size: sequences per encoder update, of the replay buffer's ``sequence_length`` each. None: 16.
        encoder_update_ratio: encoder updates per actor-critic update, may be a fraction. None: 0.5.
        encoder_learning_starts: env steps before the first encoder update. None: ``learning_starts``, often more.
        encoder_tau: how fast a target encoder follows the encoder, per update of it, in (0, 1]. The beliefs of next
            observations are the target encoder's. None: there is none, they are the encoder's.
        critic_input: what critics read beside observation and action: "task", "belief" or "both". None: "belief" where
            the encoder learns from the critics, else "task".
        task_readout: whether a small head learns to read the task off the belief, for ``task_estimate``. It teaches
            the encoder nothing, and costs about a tenth of the updates' time.
        **kwargs: keyword arguments of the algorithm that this is mixed into.

    An encoder that learns from the critics' or the actor's loss is updated with them, once per encode: batch size,
    ratio and start of its updates are not its own then, and are refused.

    Raises:
        TypeError: if an argument has a wrong name, with the nearest right one.
        ValueError: if an argument or the env cannot work, with what to do instead.
    """

    policy: TaskInferencePolicy
    _n_episode_steps: NDArray[np.int64] | None = None  # in the running episodes, (n_envs,); None: of an older agent
    ent_coef_optimizer: th.optim.Adam | None
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {}
    default_encoder: ClassVar[str | type[TaskEncoder]] = "bruno"

    def __init__(
        self,
        policy: str | type[TaskInferencePolicy],
        env: GymEnv | str,
        *args: Any,
        encoder_class: str | type[TaskEncoder] | None = None,
        encoder_kwargs: Mapping[str, Any] | None = None,
        encoder_learning_rate: float | Schedule | None = None,
        encoder_batch_size: int | None = None,
        encoder_update_ratio: float | None = None,
        encoder_learning_starts: int | None = None,
        encoder_tau: float | None = None,
        critic_input: CriticInput | None = None,
        task_readout: bool = True,
        **kwargs: Any,
    ) -> None:
        check_names(type(self).__name__, kwargs, type(self), {"policy", "env"}, TypeError)
        check_values(
            {
                **kwargs,
                "encoder_kwargs": encoder_kwargs,
                "encoder_learning_rate": encoder_learning_rate,
                "encoder_batch_size": encoder_batch_size,
                "encoder_update_ratio": encoder_update_ratio,
                "encoder_learning_starts": encoder_learning_starts,
                "encoder_tau": encoder_tau,
                "task_readout": task_readout,
            }
        )
        encoder_class = self.default_encoder if encoder_class is None else encoder_class
        check_encoder_arguments(find_encoder(encoder_class), encoder_kwargs)
        check_kinds(encoder_kwargs, find_encoder(encoder_class))
        check_kinds(kwargs.get("replay_buffer_kwargs"), TaskReplayBuffer)
        warn_of_missing_gpu(kwargs.get("device", "auto"))
        check_env(env, is_loading=not kwargs.get("_init_setup_model", True))
        self.encoder_learning_rate = encoder_learning_rate
        self.encoder_batch_size = encoder_batch_size
        self.encoder_update_ratio = encoder_update_ratio
        self.encoder_learning_starts = encoder_learning_starts
        self.encoder_tau = encoder_tau
        self._n_encoder_updates = 0
        self._encoder_updates_due = 0.0
        self._rounds_since_recall = 0
        self._saved_by: list[str] = []
        self._has_absorbed, self._n_empty_episodes = False, 0
        self._carried: Carried | None = None
        self._next_carried: Carried | None = None
        self._task_labels = TaskLabels()
        self._readout_scalars: Mapping[str, th.Tensor] = {}
        inference = {
            "encoder_class": encoder_class,
            "encoder_kwargs": encoder_kwargs,
            "target_encoder": encoder_tau is not None,
            "critic_input": critic_input,
            "readout": {} if task_readout else None,
        }
        policy_class = resolve_policy(policy, self.policy_aliases)
        joined = join_policy_kwargs(kwargs.get("policy_kwargs"), inference)
        check_policy_kwargs(
            policy_class, kwargs.get("policy_kwargs"), inference, use_sde=bool(kwargs.get("use_sde", False))
        )
        kwargs["policy_kwargs"] = joined
        super().__init__(policy_class, env, *args, **kwargs)

    def _setup_model(self) -> None:
        self._check_saved_class()
        check_algorithm(self)
        if self.env is not None:
            self.task_space = read_task_space(self.env, getattr(self, "task_space", None))
        self.policy_kwargs["task_space"] = self.task_space
        self._describe_tasks()
        self.replay_buffer_class = self.replay_buffer_class or TaskReplayBuffer
        if find_encoder(self.policy_kwargs["encoder_class"]).order == "time":
            self.replay_buffer_kwargs = {"context": "episode", **self.replay_buffer_kwargs}
        super()._setup_model()
        optimizer = getattr(self, "ent_coef_optimizer", None)
        if optimizer is not None and self.policy.optimizer_kwargs.get("fused"):
            # As fast as the policy's own; SB3 makes it without the policy's arguments.
            learned = optimizer.param_groups[0]["params"]
            self.ent_coef_optimizer = th.optim.Adam(learned, lr=self.lr_schedule(1), fused=True)
        self._setup_encoder_training()
        self._setup_readout_training()
        self.bind_buffer()
        if self._carried is not None:  # loaded, as the arrays that ``save`` made of it
            self._carried = Carried.unpack(cast(State, self._carried), self.encoder, self.device)

    def _create_aliases(self) -> None:
        super()._create_aliases()  # type: ignore[misc]  # of the algorithm that this is mixed into
        self.encoder = self.policy.encoder

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
        if not starts_anew and self.env is not None and guards.has_moved(self.env, self._n_episode_steps):
            starts_anew, self._last_obs = True, None
        if starts_anew and self.env is not None:
            # Before the reset, which restores what a copy may share with its original.
            warn_of_task_without_effect(self.env)
            check_early_resets(self.env)
            warn_of_missing_trial(self.encoder, self.env)
        result = super()._setup_learn(total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar)
        self.replay_buffer.family = family_of(self.env)
        if starts_anew:
            self._carried = None
            self._n_episode_steps = np.zeros(self.n_envs, dtype=np.int64)
            self.replay_buffer.episodes.cut()
            assert self.env is not None  # for mypy
            check_task_infos(self.env)
        return result

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Choose an action as SB3 does, at the extended observation.

        The belief that goes with it is committed in ``_store_transition``: a callback may stop in between.
        """
        assert isinstance(self._last_obs, dict)  # for mypy
        env_observation = self._last_obs
        extended, self._next_carried = self.policy.extend(env_observation, self._carried, self._last_episode_starts)
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
        guards.check_step_tasks(infos, self.replay_buffer, self.task_space)
        super()._store_transition(replay_buffer, buffer_action, new_obs, reward, dones, infos)
        if not self._has_absorbed:
            self._look_for_what_is_absorbed(new_obs, dones)
        self._carried = self._next_carried
        self._last_episode_starts = dones
        if self._n_episode_steps is not None:
            self._n_episode_steps = np.where(dones, 0, self._n_episode_steps + 1)

    def _look_for_what_is_absorbed(self, new_obs: NDArray[Any] | dict[str, NDArray[Any]], dones: NDArray[Any]) -> None:
        """Warn, once, if episodes end one after another in which no transition led to an action."""
        assert isinstance(new_obs, dict)  # for mypy
        self._has_absorbed = bool((new_obs["episode_start"] == 0).any())
        self._n_empty_episodes += int(dones.sum())
        if not self._has_absorbed and self._n_empty_episodes >= ENOUGH_EPISODES:
            guards.warn_of_empty_episodes(self._n_empty_episodes)
            self._has_absorbed = True

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> RolloutReturn:
        """Collect as in SB3. An encoder that starts before the actor-critic is trained here until that starts too.

        Stopped in the middle, by a callback or an error, the envs are a step ahead of what is stored: to learn on
        then begins new episodes.
        """
        continues = False
        try:
            with guards.finite_statistics(self._vec_normalize_env):
                rollout = super().collect_rollouts(*args, **kwargs)
            continues = rollout.continue_training
        finally:
            if not continues:
                self._last_obs = None
        before_actor = self.num_timesteps <= self.learning_starts
        if continues and before_actor and self.encoder.learns_from == "own" and self._encoder_has_started():
            gradient_steps = self.gradient_steps if self.gradient_steps >= 0 else rollout.episode_timesteps
            self._record(self._train_encoder(gradient_steps))
        return rollout

    @staticmethod
    def _wrap_env(env: GymEnv, verbose: int = 0, monitor_wrapper: bool = True) -> VecEnv:
        wrapped = OffPolicyAlgorithm._wrap_env(env, verbose, monitor_wrapper)
        keep_flag(wrapped)
        return wrapped

    def set_env(self, env: GymEnv, force_reset: bool = True) -> None:
        wrapped = self._wrap_env(env, self.verbose)
        read_task_space(wrapped, self.task_space)
        super().set_env(wrapped, force_reset)

    def learn(
        self: SelfTaskInference,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 4,
        tb_log_name: str | None = None,
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> SelfTaskInference:
        """Learn as in SB3, then settle the read-out. TensorBoard's run is named after the class, or ``tb_log_name``.

        Raises:
            TypeError: if ``total_timesteps`` or ``log_interval`` is of a wrong kind.
            ValueError: if one of them is no number to count to, or the env is not ready: ``check_early_resets``.
        """
        check_learning(total_timesteps, log_interval)
        name = tb_log_name or type(self).__name__
        super().learn(total_timesteps, callback, log_interval, name, reset_num_timesteps, progress_bar)
        self._settle_readout()
        return self
