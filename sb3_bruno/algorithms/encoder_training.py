"""Trains the encoder beside an off-policy actor-critic: by a loss of its own, or by the actor-critic's."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.common.utils import FloatSchedule, configure_logger, polyak_update, update_learning_rate
from torch import Tensor

from sb3_bruno.algorithms.carried import Carried
from sb3_bruno.algorithms.checks import check_buffer, check_encoder_updates
from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.task_estimate import example_tasks
from sb3_bruno.algorithms.values import check_whole
from sb3_bruno.buffers import TaskReplayBuffer
from sb3_bruno.buffers.long_episodes import EARLIER, WINDOW, newest, whole
from sb3_bruno.encoders import HasPosterior, Loss, TaskEncoder
from sb3_bruno.encoders.base import training_mode
from sb3_bruno.encoders.checker import check_has_something_to_teach

RECALLED = 64
"""Transitions of each running episode that a round of updates encodes again, on average over rounds."""


class EncoderTraining(OffPolicyAlgorithm):
    """Owns the encoder's optimiser and makes its updates. A part of the mixin ``TaskInference``.

    - An encoder that learns from its *own* loss is updated before each round of the actor-critic's updates,
      ``encoder_update_ratio`` times as often.
    - One that learns from the *critics'* or the *actor's* loss is updated once per encode. Hooks on their optimisers
      collect the gradient at the sampled beliefs (``buffers/critic_gradient.py``), while SB3's own loop runs unchanged.
    """

    policy: TaskInferencePolicy
    replay_buffer: TaskReplayBuffer
    encoder: TaskEncoder
    encoder_learning_rate: float | Schedule | None
    encoder_batch_size: int | None
    encoder_update_ratio: float | None
    encoder_learning_starts: int | None
    encoder_tau: float | None
    _n_encoder_updates: int
    _encoder_updates_due: float
    _rounds_since_recall: int
    _carried: Carried | None

    def _setup_encoder_training(self) -> None:
        """Make the encoder's optimiser, if the encoder can learn from the env's tasks."""
        encoder = self.encoder
        takes_all = type(encoder).check_tasks is TaskEncoder.check_tasks
        if self.env is not None and not takes_all and (tasks := example_tasks(self.env)):
            encoder.check_tasks(th.tensor(tasks))
        updates = ("encoder_batch_size", "encoder_update_ratio", "encoder_learning_starts")
        check_encoder_updates(encoder, {name: getattr(self, name) for name in updates})
        check_has_something_to_teach(encoder)
        if encoder.learns_from == "own":
            self.encoder_batch_size = 16 if self.encoder_batch_size is None else self.encoder_batch_size
            self.encoder_update_ratio = 0.5 if self.encoder_update_ratio is None else self.encoder_update_ratio
        rate = encoder.learning_rate if self.encoder_learning_rate is None else self.encoder_learning_rate
        self.encoder_lr_schedule = FloatSchedule(rate)
        learned = [{"params": list(encoder.parameters())}]  # a group may be empty, of an encoder that learns nothing
        self.encoder_optimizer = th.optim.Adam(learned, lr=self.encoder_lr_schedule(1), fused=True)

    def bind_buffer(self) -> None:
        """Give the replay buffer the encoder that its samples are made with.

        Raises:
            ValueError: if it cannot serve: ``check_buffer``.
        """
        check_buffer(self.replay_buffer, self, self.encoder)
        self.replay_buffer.set_encoder(
            self.encoder,
            self.policy.layout,
            target_encoder=self.policy.encoder_target,
            before_encode=None if self.encoder.learns_from == "own" else self._learn_from_samples,
        )

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Update the encoder and the actor-critic, the latter as SB3 does, on beliefs of the encoder as it is now.

        It may be called without ``learn``, on a replay buffer that was loaded: then the encoder is trained too, though
        the model has taken no steps.

        Raises:
            TypeError: if an argument is no whole number.
            ValueError: if ``gradient_steps`` is negative, or ``batch_size`` not positive.
        """
        check_whole("gradient_steps", gradient_steps, 0)
        check_whole("batch_size", batch_size, 1)
        if not hasattr(self, "_logger"):  # which ``learn`` makes
            self._logger = configure_logger(self.verbose)
        if self.encoder.learns_from != "own":
            self._train_with_encoder(gradient_steps, batch_size)
            return
        is_called_by_learn = self.num_timesteps > self.learning_starts  # it calls no earlier
        scalars: Mapping[str, Tensor] = {}
        if self._encoder_has_started() or not is_called_by_learn:
            scalars = self._train_encoder(gradient_steps)
        self.replay_buffer.forget_beliefs()
        super().train(gradient_steps, batch_size)
        self._record(scalars)

    def _encoder_has_started(self) -> bool:
        starts = self.learning_starts if self.encoder_learning_starts is None else self.encoder_learning_starts
        return self.num_timesteps > starts

    # -- an own loss -----------------------------------------------------------------------------------------

    def _train_encoder(self, gradient_steps: int) -> Mapping[str, Tensor]:
        """Make the updates due, ``encoder_update_ratio`` per actor-critic update: fractions add up over calls.

        Returns:
            What to log of them, by name.
        """
        assert self.encoder_update_ratio is not None  # for mypy: it learns from its own loss
        if type(self.encoder).loss is TaskEncoder.loss or self.encoder.is_frozen:  # it learns nothing
            return {}
        self._encoder_updates_due += self.encoder_update_ratio * gradient_steps
        n_updates = int(self._encoder_updates_due)
        self._encoder_updates_due -= n_updates
        if n_updates == 0:
            return {}
        self._set_learning_rate()
        with training_mode(self.encoder):
            losses = [self._update_encoder() for _ in range(n_updates)]
        return self._finish_updates([loss.scalars for loss in losses if loss is not None])

    def _update_encoder(self) -> Loss | None:
        """Take one step down the encoder's own loss; None if it has none."""
        assert self.encoder_batch_size is not None  # for mypy: it learns from its own loss
        loss = self.encoder.loss(self.replay_buffer.sample_sequences(self.encoder_batch_size, self._vec_normalize_env))
        if loss is not None:
            self.encoder_optimizer.zero_grad()
            loss.total.backward()
            self._step_encoder()
        return loss

    # -- the loss of the critics or the actor ----------------------------------------------------------------

    def _train_with_encoder(self, gradient_steps: int, batch_size: int) -> None:
        """Let SB3 update the actor-critic; the encoder learns from its samples, after each encode."""
        self._set_learning_rate()
        self.replay_buffer.forget_beliefs()
        self._scalars_of_updates: list[Mapping[str, Tensor]] = []
        with self._hooks():
            super().train(gradient_steps, batch_size)
        self._learn_from_samples()
        scalars, self._scalars_of_updates = self._scalars_of_updates, []  # a saved model holds no tensor of some device
        self._record(self._finish_updates(scalars))

    @contextmanager
    def _hooks(self) -> Iterator[None]:
        """Hook what teaches the encoder into the optimisers of actor and critics, for the time of their updates.

        A hook does not outlive a copy of its optimiser, so none is left there.
        """
        actor: Any = self.policy.actor
        critic: Any = self.policy.critic
        if self.encoder.learns_from == "critic":
            hooks = [critic.optimizer.register_step_pre_hook(self._collect_gradient)]
        else:
            hooks = [
                critic.optimizer.register_step_pre_hook(self._drop_gradient),
                actor.optimizer.register_step_pre_hook(self._collect_gradient),
            ]
        try:
            yield
        finally:
            for hook in hooks:
                hook.remove()

    def _drop_gradient(self, *_: Any) -> None:
        """Forget the gradient of a loss that does not teach the encoder. A hook of its optimiser."""
        if self.replay_buffer.gradient is not None:
            self.replay_buffer.gradient.drop()

    def _collect_gradient(self, *_: Any) -> None:
        """Keep the gradient of the loss that was just differentiated. A hook of its optimiser."""
        if self.replay_buffer.gradient is not None:
            self.replay_buffer.gradient.collect()

    def _learn_from_samples(self) -> None:
        """Take one step down what the samples of the last encode brought back, and down the encoder's own loss."""
        gradient = self.replay_buffer.gradient
        if gradient is None or gradient.n_collected == 0:
            return
        self.encoder_optimizer.zero_grad()
        gradient.backward()
        with training_mode(self.encoder):
            own = self.encoder.loss(gradient.sequences)
        if own is not None:
            own.total.backward()
        found = [parameter.grad for parameter in self.encoder.parameters() if parameter.grad is not None]
        norm = th.nn.utils.get_total_norm(found)  # before it is clipped
        scalars = {} if own is None else {name: scalar.detach() for name, scalar in own.scalars.items()}
        self._scalars_of_updates.append({**scalars, "gradient_norm": norm})
        self._step_encoder()
        self.replay_buffer.forget_beliefs()

    # -- both ------------------------------------------------------------------------------------------------

    def _set_learning_rate(self) -> None:
        learning_rate = self.encoder_lr_schedule(self._current_progress_remaining)
        update_learning_rate(self.encoder_optimizer, learning_rate)
        self.logger.record("encoder/learning_rate", learning_rate)

    def _step_encoder(self) -> None:
        """Clip the gradient, take a step, and let the target encoder follow."""
        if self.encoder.max_grad_norm is not None:
            th.nn.utils.clip_grad_norm_(self.encoder.parameters(), self.encoder.max_grad_norm)
        self.encoder_optimizer.step()
        self._follow_slowly()

    def _follow_slowly(self) -> None:
        """Move the target encoder after the encoder."""
        target = self.policy.encoder_target
        if target is not None and self.encoder_tau is not None:
            polyak_update(self.encoder.parameters(), target.parameters(), self.encoder_tau)
            for buffer, followed in zip(target.buffers(), self.encoder.buffers(), strict=True):
                buffer.copy_(followed)  # running statistics, and what is no number to average, such as an order

    def _finish_updates(self, scalars: Sequence[Mapping[str, Tensor]]) -> Mapping[str, Tensor]:
        """Encode the running episodes again, and return the mean of what each of the updates has to tell, by name."""
        self._n_encoder_updates += len(scalars)
        recalled = self._recall_running_episodes()
        self.logger.record("encoder/n_updates", self._n_encoder_updates, exclude="tensorboard")
        names = scalars[0] if scalars else ()
        means = {name: th.stack([update[name] for update in scalars]).mean() for name in names}
        means |= self.encoder.diagnostics()
        return {**{f"encoder/{name}": value for name, value in means.items()}, **recalled}

    def _record(self, scalars: Mapping[str, Tensor]) -> None:
        """Log tensors of shape () as numbers. After SB3's updates, which wait for a GPU anyway, it waits no longer."""
        if scalars:
            numbers = th.stack([scalar.detach() for scalar in scalars.values()]).tolist()  # in one transfer
            for name, number in zip(scalars, numbers, strict=True):
                self.logger.record(name, number)

    def _recall_running_episodes(self) -> Mapping[str, Tensor]:
        """Encode the running episodes again, so that a carried belief hardly mixes an old encoder with a new.

        Episodes of up to 64 transitions are encoded again after every round of updates, longer ones less often, or a
        round would cost the more the longer they are. Example: an episode of 200 is due every fourth round. Of more
        than 384, an encoder that reads in any order encodes the newest 128 and a sample that stands for the others, as
        in replay (``buffers/long_episodes.py``); one that reads in time has to encode all. The newest transition is
        left out: the next observation brings it.

        Returns:
            What to log of their beliefs, by name; empty if none was encoded.
        """
        if self._carried is None:
            return {}
        slots, lengths = self.replay_buffer.episodes.running()
        known = np.maximum(lengths - 1, 0)
        n_read = min(lengths.max(), EARLIER + WINDOW) if self.encoder.order == "any" else lengths.max()
        self._rounds_since_recall += 1
        if RECALLED * self._rounds_since_recall < n_read:
            return {}
        self._rounds_since_recall = 0
        rows = newest(slots, known, self.replay_buffer.rng) if self.encoder.order == "any" else whole(slots, known)
        assert rows.counts is not None  # for mypy: of episodes there are
        transitions = self.replay_buffer.transitions(rows.slots, self._vec_normalize_env)
        with th.no_grad():
            weights = self.replay_buffer.to_torch(self.replay_buffer.absorbed(rows.slots) * rows.counts)
            memory = self.encoder.last(transitions, weights)
            memory = self.encoder.with_noise_of(memory, self._carried.memory)  # z is not redrawn in mid-episode
            if isinstance(self.encoder, HasPosterior):
                posterior = self.encoder.posterior(memory)
                beliefs = {"belief/mean_abs": posterior.mean.abs().mean(), "belief/var": posterior.variance.mean()}
            else:
                beliefs = {"belief/mean_abs": self.encoder.belief(memory).abs().mean()}
        self._carried = self._carried._replace(memory=memory)
        return beliefs
