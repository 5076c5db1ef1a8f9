"""Trains the read-out of the task beside the encoder, which it teaches nothing."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.type_aliases import GymEnv, TensorDict
from stable_baselines3.common.utils import update_learning_rate
from torch import Tensor

from sb3_bruno.algorithms.checks import check_has_buffer
from sb3_bruno.algorithms.encoder_training import EncoderTraining
from sb3_bruno.algorithms.readout_parameters import check_readout
from sb3_bruno.algorithms.task_estimate import TaskLabels, few_tasks, list_tasks, read_labels
from sb3_bruno.algorithms.values import check_whole
from sb3_bruno.buffers.random_generator import random_generator
from sb3_bruno.buffers.sampled_episodes import sample_episodes
from sb3_bruno.buffers.transfer import to_device
from sb3_bruno.encoders.task_readout import ListReadout, TaskReadout

EVERY = 8
"""Updates of the actor-critic for each of the read-out."""
N_EPISODES = 8
"""Episodes per update."""
N_STEPS = 8
"""Steps drawn of each episode, early ones more often: there beliefs differ most."""
LOGGED = (1, 5, 20)
"""Transitions after which the error is logged; these steps are always among those drawn."""
LEARNING_RATE = 3e-3
N_TO_SETTLE = 500
"""Updates, at most, that settle the read-out when learning ends."""


class ReadoutTraining(EncoderTraining):
    """Owns the read-out's optimiser and makes its updates. A part of the mixin ``TaskInference``.

    It learns from episodes of the replay buffer, encoded as the agent met them, and from the tasks that are stored
    there. When learning ends, it is settled. Its random numbers are its own, so an agent is the same without it.
    """

    _task_labels: TaskLabels
    _readout_due: int = 0
    _readout_unsettled: int = 0  # updates at the full learning rate, on an encoder that moves
    _readout_scalars: Mapping[str, Tensor]
    _readout_rng: np.random.Generator

    @property
    def task_labels(self) -> TaskLabels:
        """What the tasks that the agent was trained on are called."""
        names, units, tasks = self._task_labels  # lists, of a model that was loaded
        return TaskLabels(tuple(names), tuple(units), tuple(tasks))

    def _describe_tasks(self) -> None:
        """Ask the env what the read-out has to tell, unless that is known from before."""
        if self.env is None or self.policy_kwargs.get("readout") != {}:
            return
        tasks = few_tasks(self.env)
        self.policy_kwargs["readout"] = {"tasks": None if tasks is None else tasks.tolist()}
        self._task_labels = read_labels(self.env, tasks)

    def _setup_readout_training(self) -> None:
        """Make the read-out's optimiser, if there is a read-out."""
        if self.policy.readout is not None:
            self.readout_optimizer = th.optim.Adam(self.policy.readout.parameters(), lr=LEARNING_RATE, fused=True)
            if not hasattr(self, "_readout_rng"):  # of a model that is made, not loaded
                self._readout_rng = random_generator(self.seed)

    def set_random_seed(self, seed: int | None = None) -> None:
        """Seed as SB3 does, and what draws from the replay buffer."""
        super().set_random_seed(seed)
        if seed is not None and self.replay_buffer is not None:  # of a model that is complete
            self.replay_buffer.rng, self._readout_rng = random_generator(), random_generator(seed)

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Update the encoder and the actor-critic, and every eighth time the read-out of the task.

        Raises:
            TypeError: if an argument is no whole number.
            ValueError: if ``gradient_steps`` is negative, ``batch_size`` not positive, or there is no replay buffer.
        """
        check_whole("gradient_steps", gradient_steps, 0)
        check_whole("batch_size", batch_size, 1)
        check_has_buffer(self.replay_buffer)
        if self.replay_buffer.encoder is not self.encoder:  # it was copied, or taken from elsewhere
            self.bind_buffer()
        if self.policy.readout is not None:
            n_updates, self._readout_due = divmod(self._readout_due + gradient_steps, EVERY)
            if n_updates > 0:
                self._readout_scalars = self._train_readout(self.policy.readout, n_updates)
                self._readout_unsettled += n_updates
        super().train(gradient_steps, batch_size)

    def _record(self, scalars: Mapping[str, Tensor]) -> None:
        read, self._readout_scalars = self._readout_scalars, {}
        super()._record({**scalars, **read})  # all in one transfer

    def fit_readout(self, n_updates: int = 1_000) -> None:
        """Train the read-out of the task alone, on the replay buffer; make one if there is none, or of other tasks.

        For an agent that was trained without one. ``learn`` settles the read-out that it trains by itself.

        Args:
            n_updates: of eight episodes each, whose learning rate falls to 0.

        Raises:
            TypeError: if ``n_updates`` is no whole number.
            ValueError: if it is not positive, there is no replay buffer or an empty one, or the agent has no env to ask
                for its tasks.

        Example:
            >>> model = BrunoSAC.load("agent", env=env, learning_starts=0, gradient_steps=0)
            >>> model.learn(20_000)  # acts only
            >>> model.fit_readout()
        """
        check_whole("n_updates", n_updates, 1)
        check_has_buffer(self.replay_buffer)
        if self.replay_buffer.size() == 0:
            raise ValueError("The replay buffer is empty: collect transitions, or load a replay buffer first.")
        if self.policy.readout is None or self._has_other_tasks():
            self._add_readout()
        assert self.policy.readout is not None  # for mypy: it was added
        self._fit(self.policy.readout, n_updates)

    def _settle_readout(self) -> None:
        """Fit the read-out to the encoder at rest, by as many updates as it has had on a moving one, but not many.

        While both learn, the read-out is always a little behind. On PointRotation it missed an angle's sine and cosine
        by .04 when learning ended, which was more than it owned up to, and by .002 after 500 updates.
        """
        n_updates, self._readout_unsettled = min(self._readout_unsettled, N_TO_SETTLE), 0
        if self.policy.readout is not None:
            self._fit(self.policy.readout, n_updates)

    def _fit(self, readout: TaskReadout, n_updates: int) -> None:
        """Make updates at a learning rate that falls to 0."""
        try:
            for done in range(n_updates):
                update_learning_rate(self.readout_optimizer, LEARNING_RATE * (1 - done / n_updates))
                self._train_readout(readout, 1)
        finally:
            update_learning_rate(self.readout_optimizer, LEARNING_RATE)

    def _has_other_tasks(self) -> bool:
        """Tell whether the env has tasks that are none of the few that the read-out tells apart."""
        readout = self.policy.readout
        if self.env is None or not isinstance(readout, ListReadout):
            return False
        tasks, known = list_tasks(self.env), readout.tasks.tolist()
        return tasks is None or any(task not in known for task in tasks)

    def set_env(self, env: GymEnv, force_reset: bool = True) -> None:
        super().set_env(env, force_reset)
        self.warn_of_other_tasks()

    def warn_of_other_tasks(self) -> None:
        """Warn if the env, which the agent was just given, has tasks that the read-out takes for others."""
        if self._has_other_tasks():
            warnings.warn(
                "The env has tasks that the agent's read-out does not know, and takes for those that it knows: once "
                "transitions are collected, `fit_readout` learns another.",
                stacklevel=3,
            )

    def set_parameters(
        self, load_path_or_dict: str | TensorDict, exact_match: bool = True, device: th.device | str = "auto"
    ) -> None:
        given: Any = load_path_or_dict  # a dict, as ``Saving`` gives it
        order = check_readout(self.policy.readout, given.get("policy"), exact_match=exact_match)
        super().set_parameters(given, exact_match, device)
        if order is not None:  # of the same tasks: their names come along
            tasks, labels = self.policy_kwargs["readout"]["tasks"], self.task_labels
            self.policy_kwargs["readout"] = {"tasks": [tasks[i] for i in order]}
            self._task_labels = labels._replace(tasks=tuple(labels.tasks[i] for i in order))

    def _add_readout(self) -> None:
        if self.env is None:
            raise ValueError("The agent has no env to ask what its tasks are: load it with `env=...`.")
        self.policy_kwargs["readout"] = {}
        self._describe_tasks()
        self.policy.add_readout(self.policy_kwargs["readout"])
        self._setup_readout_training()

    def _train_readout(self, readout: TaskReadout, n_updates: int) -> Mapping[str, Tensor]:
        """Make updates; return what to log of the last one, by name."""
        readout.train()
        try:
            for _ in range(n_updates):
                scalars = self._update_readout(readout)
        finally:
            readout.eval()
        return scalars

    def _update_readout(self, readout: TaskReadout) -> Mapping[str, Tensor]:
        told = sample_episodes(
            self.replay_buffer,
            N_EPISODES,
            bounded=self.encoder.order == "any",
            rng=self._readout_rng,
            env=self._vec_normalize_env,
        )
        transitions, tasks, weights = told.sequences
        columns, counts = _draw_columns(told.is_read, self._readout_rng)
        lengths, counted, is_spared = to_device([columns, counts, told.is_spared[:, None]], self.device)
        with th.no_grad():
            features = readout.prefix_features(self.encoder, transitions, weights, lengths.long())
        loss = readout.loss(features, tasks, counted, is_spared > 0)
        self.readout_optimizer.zero_grad()
        loss.backward()
        self.readout_optimizer.step()
        scalars = {"readout/loss": loss.detach()}
        with th.no_grad():
            error = readout.error(readout(features), tasks.unsqueeze(-2))
            means = (counted * error).sum(dim=0) / counted.sum(dim=0)
        exists = counts.any(axis=0)
        return scalars | {f"readout/error_after_{n}": means[i] for i, n in enumerate(LOGGED) if exists[i]}

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        state_dicts, variables = super()._get_torch_save_params()
        return [*state_dicts, *(["readout_optimizer"] if self.policy.readout is not None else [])], variables

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "readout_optimizer"]


def _draw_columns(is_read: Any, rng: np.random.Generator) -> tuple[Any, Any]:
    """Draw which prefixes of each row to read: those of ``LOGGED``, then ``N_STEPS`` others, early ones more often.

    Args:
        is_read: where the belief before a step is that of all steps before it, (n, time).
        rng: draws them.

    Returns:
        Columns, and whether each counts, float32: both (n, 3 + N_STEPS). A prefix that a row lacks does not count.
    """
    n, time = is_read.shape
    begin, length = np.argmax(is_read, axis=1)[:, None], is_read.sum(axis=1)[:, None]
    rank = np.floor((length + 1) ** rng.random((n, N_STEPS))).astype(np.int64) - 1
    drawn = begin + np.minimum(rank, length - 1)
    logged = np.broadcast_to(np.minimum(LOGGED, time - 1), (n, len(LOGGED)))
    exists = (np.array(LOGGED) < begin + length) & (begin == 0)
    counts = np.pad(exists, ((0, 0), (0, N_STEPS)), constant_values=True)
    return np.concatenate([logged, drawn], axis=1), counts.astype(np.float32)
