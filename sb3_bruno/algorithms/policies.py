"""Policies whose actor acts on observation and belief, and whose belief travels through ``predict``.

The policy owns the task encoder, so that device, ``state_dict``, ``save`` and ``load`` take it along.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import torch as th
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.distributions import SquashedDiagGaussianDistribution
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, FlattenExtractor
from stable_baselines3.common.type_aliases import PyTorchObs, Schedule

from sb3_bruno.algorithms.carried import Carried, State
from sb3_bruno.algorithms.diverged import explain_divergence
from sb3_bruno.algorithms.forgetting import absorb_or_forget
from sb3_bruno.algorithms.lean_networks import LeanCritic, LeanSquashedGaussian
from sb3_bruno.algorithms.reading import read_episode_start, read_observation, warn_of_state
from sb3_bruno.algorithms.values import is_number
from sb3_bruno.buffers.extended_obs import CriticInput, ExtendedObs, SliceExtractor
from sb3_bruno.buffers.numbers import check_numbers, place_in_env
from sb3_bruno.buffers.transfer import to_device
from sb3_bruno.encoders import BrunoEncoder, Predicts, TaskEncoder, Transitions, find_encoder
from sb3_bruno.encoders.abilities import check_ability
from sb3_bruno.encoders.task_readout import TaskReadout, make_readout

POLICY_NAMES = ("MlpPolicy", "MultiInputPolicy")
"""Names of a policy in SB3. Both mean the same here: the observation is a Dict, and networks read flat slices of it."""
Observation = NDArray[Any] | th.Tensor | dict[str, NDArray[Any]]


class TaskInferencePolicy(BasePolicy):
    """Makes SB3's actor-critic policies act on observation and belief. A mixin.

    Args:
        observation_space: the Dict of ``TransitionObservation``.
        action_space: action space.
        lr_schedule: learning rate schedule of actor and critics.
        task_space: the space of task vectors, which critics may read.
        encoder_class: task encoder, or its name in ``ENCODERS``.
        encoder_kwargs: arguments of the encoder beyond the dimensions.
        target_encoder: whether there is a slow copy of the encoder, for the beliefs of next observations.
        critic_input: what critics read beside observation and action: "task", "belief" or "both". None: "belief"
            where the encoder learns from the critics, which then must read it, else "task".
        readout: all tasks that there are as ``{"tasks": ...}``, or None in their place where they are many: makes
            the read-out of the task. None: there is no read-out.
        forget_threshold: nats of evidence for another task at which ``predict`` forgets what came before; None:
            never. For tasks that switch in mid-episode; may be set on a trained policy. Training never forgets.
        **kwargs: arguments of the policy that this is mixed into.

    Attributes:
        critic_class: of the critics; None: that of the policy that this is mixed into.

    Raises:
        ValueError: if a features extractor is asked for, which the extended observation would drop silently,
            ``forget_threshold`` is not positive or the encoder cannot notice a switch, or the critics do not read the
            belief that they should teach.
    """

    critic_class: ClassVar[type[LeanCritic] | None] = None
    observation_space: spaces.Dict
    encoder: TaskEncoder
    encoder_target: TaskEncoder | None
    readout: TaskReadout | None
    critic_input: CriticInput
    actor_kwargs: dict[str, Any]
    critic_kwargs: dict[str, Any]

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Box,
        lr_schedule: Schedule,
        *,
        task_space: spaces.Box,
        encoder_class: str | type[TaskEncoder] = BrunoEncoder,
        encoder_kwargs: Mapping[str, Any] | None = None,
        target_encoder: bool = False,
        critic_input: CriticInput | None = None,
        readout: Mapping[str, Any] | None = None,
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
        self.encoder_class = find_encoder(encoder_class)
        self.encoder_kwargs = dict(encoder_kwargs or {})
        self._has_target_encoder = target_encoder
        self._given_critic_input = critic_input
        self._readout_kwargs = readout
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)
        self.forget_threshold = forget_threshold

    @property
    def forget_threshold(self) -> float | None:
        """Nats of evidence for another task at which ``predict`` forgets what came before; None: never."""
        return self._forget_threshold

    @forget_threshold.setter
    def forget_threshold(self, nats: float | None) -> None:
        if nats is not None and not (is_number(nats) and nats > 0):
            raise ValueError(f"`forget_threshold` must be positive nats, got {nats!r}: None never forgets.")
        if nats is not None:
            check_ability(self.encoder, Predicts, f"`forget_threshold={nats}`")
        self._forget_threshold = nats

    def _build(self, lr_schedule: Schedule) -> None:
        observation_dim = spaces.flatdim(self.observation_space["observation"])
        task_dim = spaces.flatdim(self.task_space)
        encoder = self.encoder_class.build(
            observation_dim, spaces.flatdim(self.action_space), task_dim, **self.encoder_kwargs
        )
        self.critic_input = self._given_critic_input or ("belief" if encoder.learns_from == "critic" else "task")
        if encoder.learns_from == "critic" and self.critic_input == "task":
            raise ValueError(
                "`critic_input='task'` teaches an encoder that learns from the critics nothing, for they do not read "
                "the belief: use 'belief' or 'both', or an encoder that learns from the actor."
            )
        self.layout = ExtendedObs(observation_dim, encoder.belief_dim, task_dim)
        for net_kwargs in (self.actor_kwargs, self.critic_kwargs):
            net_kwargs["observation_space"] = self.layout.space
        super()._build(lr_schedule)  # type: ignore[misc]  # of the policy it is mixed into
        # After the actor: SB3 looks for a policy's device at its first parameter, four times in a rollout's step.
        self.encoder = encoder.eval()  # train mode is for its own updates
        self.encoder_target = copy.deepcopy(encoder).requires_grad_(False) if self._has_target_encoder else None
        self.readout = None
        if self._readout_kwargs is not None:
            self.add_readout(self._readout_kwargs)

    def add_readout(self, kwargs: Mapping[str, Any]) -> None:
        """Make the read-out of the task, from what the argument ``readout`` says."""
        self._readout_kwargs = kwargs
        made = make_readout(self.encoder, spaces.flatdim(self.task_space), **kwargs)
        self.readout = made.to(self.device).eval()

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        extractor = SliceExtractor(self.layout.space, self.layout.actor_slices)
        actor = super().make_actor(extractor)  # type: ignore[misc]  # of the policy it is mixed into
        if type(getattr(actor, "action_dist", None)) is SquashedDiagGaussianDistribution:
            actor.action_dist = LeanSquashedGaussian(actor.action_dist.action_dim)
        return actor

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        extractor = SliceExtractor(self.layout.space, self.layout.critic_slices(self.critic_input))
        if self.critic_class is None:
            return super().make_critic(extractor)  # type: ignore[misc]  # likewise
        return self.critic_class(**self._update_features_extractor(self.critic_kwargs, extractor)).to(self.device)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        data = super()._get_constructor_parameters()
        data.update(
            task_space=self.task_space,
            encoder_class=self.encoder_class,
            encoder_kwargs=self.encoder_kwargs,
            target_encoder=self._has_target_encoder,
            critic_input=self.critic_input,
            readout=self._readout_kwargs,
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
        """Act, as SB3's recurrent policies do: pass back the ``state`` that the last call returned.

        Args:
            observation: what ``TransitionObservation`` returns, or a batch of it; or extended, as in the replay buffer.
            state: the belief so far; None is the prior.
            episode_start: where True, shape (n_envs,), the belief starts again from the prior.
            deterministic: the actor's mode instead of a sample.

        Returns:
            The actions, and the state after this observation.

        Raises:
            ValueError: if ``state`` is none that this policy returned for these envs, an array is no extended
                observation, a key of the observation is missing or holds a number that is not finite, or the actions
                are not finite.
        """
        if not isinstance(observation, dict):
            return self._act(observation, deterministic), state
        carried = None if state is None else Carried.unpack(state, self.encoder, self.device)
        extended, carried = self.extend(observation, carried, episode_start, self.forget_threshold)
        return self._act(extended, deterministic), carried.pack()

    def _act(self, extended: NDArray[Any] | th.Tensor, deterministic: bool) -> NDArray[Any]:
        actions, _ = super().predict(extended, deterministic=deterministic)  # type: ignore[arg-type]  # a tensor too
        if not np.isfinite(actions).all():
            raise ValueError(explain_divergence(self.encoder))
        return actions

    @th.inference_mode()
    def extend(
        self,
        observation: dict[str, NDArray[Any]],
        carried: Carried | None = None,
        episode_start: NDArray[Any] | None = None,
        forget_threshold: float | None = None,
    ) -> tuple[th.Tensor, Carried]:
        """Absorb the transition that led to ``observation`` and lay out the extended observation.

        The Dict's own ``episode_start`` says that no transition led here; the argument says that the belief
        starts again. All that comes from the host goes to the device in one transfer, and nothing comes back.
        Without a ``forget_threshold`` nothing is forgotten: so it is in rollouts of training, as in their replay.

        Returns:
            The extended observation, shape (n_envs, dim) or (dim,) as ``observation`` was, and what to carry on.

        Raises:
            ValueError: if the observation is not that of ``TransitionObservation``, or holds a number that is not
                finite, or what is carried or ``episode_start`` is of other envs.
        """
        parts, vectorized = read_observation(observation, self.observation_space)
        n_envs = len(parts["observation"])
        check_numbers(parts, place_in_env)
        if carried is not None and carried.observation.shape != parts["observation"].shape:
            raise ValueError(
                f"`state` is of {len(carried.observation)} envs and observations of {carried.observation.shape[1]} "
                f"numbers, not of {n_envs} and {parts['observation'].shape[1]}: pass back the state that `predict` "
                "returned for these."
            )
        fresh = read_episode_start(episode_start, n_envs)
        start = parts["episode_start"].reshape(n_envs)
        began = start > 0  # also if VecNormalize has centred it
        warn_of_state(start, fresh, has_state=carried is not None)
        if carried is None:
            fresh = np.ones_like(began)
        began = began | fresh
        columns = [parts["observation"], parts["action"], parts["reward"], fresh[:, None], began[:, None]]
        here, action, reward, fresh_column, began_column = to_device(columns, self.device)
        nothing = Carried.start(self.encoder, here, may_forget=forget_threshold is not None)
        if carried is None:
            carried = nothing
        elif forget_threshold is None:  # an agent may be told to forget, or not to, in mid-episode
            carried = carried._replace(suspicion=None)
        elif carried.suspicion is None:
            carried = carried._replace(suspicion=nothing.suspicion)
        carried = carried.where(fresh_column <= 0, nothing) if fresh.any() else carried
        after = self._absorb(carried, Transitions(carried.observation, action, reward, here), forget_threshold)
        if began.any():
            begun = carried._replace(memory=self.encoder.start_episode(carried.memory))
            after = begun.where(began_column > 0, after)
        after = after._replace(observation=here)
        extended = self.layout.join(here, self.encoder.belief(after.memory))
        return (extended if vectorized else extended[0]), after

    def _absorb(self, carried: Carried, transitions: Transitions, forget_threshold: float | None) -> Carried:
        memory, _, suspicion = carried
        if forget_threshold is None or suspicion is None:
            return carried._replace(memory=self.encoder.absorb(memory, transitions))
        memory, suspicion = absorb_or_forget(self.encoder, memory, suspicion, transitions, forget_threshold)
        return carried._replace(memory=memory, suspicion=suspicion)

    def set_training_mode(self, mode: bool) -> None:
        """Change the mode, as in SB3, unless it is that already: SB3 asks twice in every step of a rollout."""
        if mode != self.training:
            super().set_training_mode(mode)

    def obs_to_tensor(self, observation: Observation) -> tuple[PyTorchObs, bool]:
        """Convert an observation, as in SB3, or an extended one, shape (n_envs, dim) or (dim,).

        Raises:
            ValueError: if an array is not an extended observation, or holds a number that is not finite.
        """
        if isinstance(observation, dict):
            return super().obs_to_tensor(observation)
        array = observation if isinstance(observation, th.Tensor) else np.asarray(observation)
        if array.shape[-1:] != (self.layout.dim,):
            raise ValueError(
                f"Expected the Dict of `TransitionObservation` or an extended observation of size {self.layout.dim}, "
                f"got an array of shape {array.shape}: wrap the env in `sb3_bruno_envs.TransitionObservation`."
            )
        if not isinstance(array, th.Tensor):  # a tensor is ours, of a rollout: its parts were checked
            check_numbers({"observation": array.reshape(-1, self.layout.dim)}, place_in_env)
        return th.as_tensor(array, device=self.device).reshape(-1, self.layout.dim), array.ndim > 1
