"""A replay buffer grouped by task, whose samples are extended observations [observation | belief | task].

It knows the encoder only when it samples: beliefs are never stored, they are computed afresh with the encoder of
that moment.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypedDict, get_args

import numpy as np
import torch as th
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.buffers.critic_gradient import BeliefGradient
from sb3_bruno.buffers.encoded_sequences import EncodedSequences
from sb3_bruno.buffers.extended_obs import ExtendedObs
from sb3_bruno.buffers.long_episodes import EpisodeRows
from sb3_bruno.buffers.task_ring import TaskRing
from sb3_bruno.buffers.transfer import to_device
from sb3_bruno.encoders import TaskEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.base import training_mode

Context = Literal["iid", "recent", "episode"]


SAMPLING = ("context", "n_sequences", "sequence_length", "n_recent")
"""The arguments that say how samples are drawn, of which what is stored knows nothing."""


class BufferArguments(TypedDict, total=False):
    """The ``replay_buffer_kwargs`` of ``TaskReplayBuffer``."""

    handle_timeout_termination: bool
    n_sequences: int
    sequence_length: int
    context: Context
    n_recent: int


_BOUND = ("_encoder", "_layout", "_target_encoder", "_before_encode", "_encoded")


class TaskReplayBuffer(TaskRing):
    """Keeps transitions grouped by the task in ``info["task"]``.

    A sample is ``n_sequences`` tasks, drawn uniformly with replacement, with a sequence of transitions each. The
    belief at a transition is that of the transitions before it in its sequence; ``context`` says which those are:

    - ``"iid"``: drawn from all transitions of the task, none twice if there are enough (the paper: with replacement)
    - ``"recent"``: the same, from the task's last ``n_recent`` transitions
    - ``"episode"``: what the agent had itself seen at that step, in its order (an episode whose first rows were
      overwritten begins at the first that is left). Of a ``Trial``, all its inner episodes are one. Of an episode of
      more than 384 steps, 128 in a row are read, after 256 of the earlier ones, each of which counts for several; an
      encoder that reads in order reads all

    Args:
        buffer_size: number of transitions, over all environments.
        observation_space: the Dict of ``TransitionObservation``.
        action_space: action space.
        device: PyTorch device of the samples.
        n_envs: number of environments.
        optimize_memory_usage: not supported, raises.
        handle_timeout_termination: do not treat a time limit as termination.
        n_sequences: tasks per sample.
        sequence_length: transitions per task in ``"iid"`` and ``"recent"`` sequences.
        context: which transitions a belief rests on.
        n_recent: with ``context="recent"``, how many transitions of a task count as recent.

    Attributes:
        family: the id of the env that filled it; None if that has none.

    Raises:
        ValueError: if an argument is out of its range, or ``optimize_memory_usage`` is asked for.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Dict,
        action_space: spaces.Space[Any],
        device: th.device | str = "auto",
        n_envs: int = 1,
        optimize_memory_usage: bool = False,
        handle_timeout_termination: bool = True,
        *,
        n_sequences: int = 16,
        sequence_length: int = 64,
        context: Context = "iid",
        n_recent: int = 1_000,
    ) -> None:
        if optimize_memory_usage:
            raise ValueError(
                "`optimize_memory_usage=True` is not supported: the last observation of an episode would be lost. "
                "Lower `buffer_size` instead."
            )
        for name, value in (("n_sequences", n_sequences), ("sequence_length", sequence_length), ("n_recent", n_recent)):
            if value < 1:
                raise ValueError(f"`{name}` must be at least 1, got {value}.")
        if context not in get_args(Context):
            raise ValueError(f"`context` must be 'iid', 'recent' or 'episode', got {context!r}.")
        super().__init__(buffer_size, observation_space, action_space, device, n_envs, handle_timeout_termination)
        self.n_sequences = n_sequences
        self.sequence_length = sequence_length
        self.context = context
        self.n_recent = n_recent
        self.family: str | None = None
        self._encoder: TaskEncoder | None = None
        self._encoded: EncodedSequences | None = None

    def set_encoder(
        self,
        encoder: TaskEncoder,
        layout: ExtendedObs,
        *,
        target_encoder: TaskEncoder | None = None,
        before_encode: Callable[[], None] | None = None,
    ) -> None:
        """Bind what samples are made with. Nothing of it is pickled: bind again after unpickling.

        Args:
            encoder: computes the beliefs.
            layout: lays out the extended observation.
            target_encoder: computes the beliefs of the next observations; None: ``encoder`` does.
            before_encode: called before new sequences are encoded, so that an encoder that learns from the samples of
                the last ones can take its step.
        """
        self._encoder = encoder
        self._layout = layout
        self._target_encoder = target_encoder
        self._before_encode = before_encode
        self.forget_beliefs()

    @property
    def encoder(self) -> TaskEncoder | None:
        """The encoder that samples are made with; None after unpickling."""
        return self._encoder

    @property
    def gradient(self) -> BeliefGradient | None:
        """The way back to the beliefs in the last samples, where the encoder learns from their losses."""
        return None if self._encoded is None else self._encoded.gradient

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in super().__getstate__().items() if key not in _BOUND}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._encoder = self._encoded = None

    def reset(self) -> None:
        super().reset()
        self.forget_beliefs()

    def add(self, *args: Any, **kwargs: Any) -> None:
        """Store one transition per environment.

        Raises:
            ValueError: if a task or a number cannot be stored: ``TaskRing.add``.
        """
        self.forget_beliefs()
        super().add(*args, **kwargs)

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> ReplayBufferSamples:
        """Sample transitions between extended observations.

        Consecutive calls read on in the same encoded sequences until these are used up or ``forget_beliefs`` is
        called: with 16 sequences of 64 transitions and a batch size of 256, one encode serves four calls exactly.

        Args:
            batch_size: number of transitions, spread evenly over the sequences.
            env: the VecNormalize, if any, that normalises as it does in the rollouts.

        Returns:
            Observations and next observations (batch_size, extended dim), the rest as in SB3.

        Raises:
            RuntimeError: if the buffer is empty or no encoder is bound.
            ValueError: if ``batch_size`` is not positive.
        """
        if self._encoder is None:
            raise RuntimeError("No encoder is bound: call the model's `bind_buffer` before `sample`.")
        if batch_size < 1:
            raise ValueError(f"`batch_size={batch_size}` is no number of transitions: give 1 or more.")
        n_sequences = min(self.n_sequences, batch_size)
        per_row = -(-batch_size // n_sequences)
        if self._encoded is None or not self._encoded.has(n_sequences, per_row):
            if self._before_encode is not None:
                self._before_encode()
            self._encoded = self._encode(self._encoder, n_sequences, per_row, env)
        return self._encoded.read(batch_size, per_row)

    def forget_beliefs(self) -> None:
        """Encode new sequences before the next sample: the encoder, the normalisation or the data changed."""
        self._encoded = None

    def _encode(
        self, encoder: TaskEncoder, n_sequences: int, per_row: int, env: VecNormalize | None
    ) -> EncodedSequences:
        rows, drawn = self._context_rows(n_sequences)
        slots, sequences = rows.slots, self.sequences(rows, drawn, env)
        transitions, tasks, weights = sequences
        gradient = None
        noise = encoder.redraw(encoder.empty((n_sequences, 1)))
        if encoder.learns_from == "own":
            # Inference mode is faster than no_grad. What is joined below is ordinary again, as gradients need it.
            with th.inference_mode():
                beliefs = encoder.prefix_beliefs(transitions, weights, noise)
        else:
            # Out of training mode cuDNN keeps nothing for the backward pass of a recurrent network.
            with th.enable_grad(), training_mode(encoder):
                beliefs = encoder.prefix_beliefs(transitions, weights, noise)
            gradient = BeliefGradient(sequences, beliefs[:, :-1], self._layout.belief)
            beliefs = beliefs.detach()
        later = beliefs
        if self._target_encoder is not None:
            with th.inference_mode():
                later = self._target_encoder.prefix_beliefs(transitions, weights, noise)
        arrivals, now, later = transitions.next_observations, later[:, :-1], later[:, 1:]
        inner_ends = self.flat(self.inner_ends)[slots]
        if inner_ends.any():  # the next inner episode begins, and nothing was absorbed: values flow on from there
            ended = th.as_tensor(inner_ends, device=self.device)[..., None]
            (begun,) = to_device([self.restarts(slots[inner_ends], env)], self.device)
            arrivals = arrivals.masked_scatter(ended, begun)
            later = th.where(ended, now, later)
        tasks = tasks[:, None].expand(-1, slots.shape[1], -1)
        dones = self.flat(self.dones)[slots] * (1 - self.flat(self.timeouts)[slots])
        scalars = [self._normalize_reward(self.flat(self.rewards)[slots], env)[..., None], dones[..., None]]
        actions, rewards, done = to_device([self.flat(self.actions)[slots], *scalars], self.device)
        samples = ReplayBufferSamples(
            observations=self._layout.join(transitions.observations, beliefs[:, :-1], tasks),
            actions=actions,
            next_observations=self._layout.join(arrivals, later, tasks),
            dones=done,
            rewards=rewards,
        )
        return EncodedSequences(samples, rows.is_read, self.rng, per_row, gradient)

    def sample_sequences(self, n_sequences: int, env: VecNormalize | None = None) -> TaskSequences:
        """Sample sequences of transitions of one task each: what the encoder learns from.

        Returns:
            Exchangeable ones of shape (n_sequences, sequence_length, dim), or whole episodes for an encoder that reads
            them in their order.

        Raises:
            RuntimeError: if the buffer is empty.
            ValueError: if ``n_sequences`` is not positive.
        """
        if n_sequences < 1:
            raise ValueError(f"`n_sequences={n_sequences}` is no number of sequences: give 1 or more.")
        if self._encoder is not None and self._encoder.order == "time":
            return self.sequences(*self._context_rows(n_sequences), env)
        return self.sequences(*self._exchangeable_rows(n_sequences), env)

    def sequences(self, rows: EpisodeRows, tasks: NDArray[np.float32], env: VecNormalize | None) -> TaskSequences:
        """Gather sequences. Of episodes, a transition weighs as many as it tells of, and 0 if it was never absorbed."""
        slots, time = rows.slots, rows.slots.shape[1]
        columns = np.broadcast_to(tasks[:, None], (len(slots), time, tasks.shape[1]))
        *transitions, task = to_device([*self.observed(slots, env), columns], self.device)
        weights = None
        if rows.counts is not None:
            weights = self.to_torch(self.absorbed(slots) * rows.counts)
        return TaskSequences(Transitions(*transitions), task[:, 0], weights)

    def _context_rows(self, n_sequences: int) -> tuple[EpisodeRows, NDArray[np.float32]]:
        """Draw rows (n_sequences, time) and their tasks (n_sequences, task_dim)."""
        if self.context == "episode":
            bounded = self._encoder is not None and self._encoder.order == "any"
            return self.episode_rows(n_sequences, bounded=bounded)
        return self._exchangeable_rows(n_sequences)

    def _exchangeable_rows(self, n_sequences: int) -> tuple[EpisodeRows, NDArray[np.float32]]:
        n_recent = self.n_recent if self.context == "recent" else None
        slots, tasks = self.exchangeable_slots(n_sequences, self.sequence_length, n_recent)
        return EpisodeRows(slots, None, np.ones(slots.shape, dtype=bool)), tasks
