"""A replay buffer grouped by task, whose samples are extended observations [observation | belief | task].

It knows the encoder only when it samples: beliefs are never stored, they are computed afresh with the encoder of
that moment.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import torch as th
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.buffers.encoded_sequences import EncodedSequences
from sb3_bruno.buffers.episode_index import EpisodeIndex, Slots
from sb3_bruno.buffers.extended_obs import ExtendedObs
from sb3_bruno.buffers.task_index import SlotQueue, TaskIndex
from sb3_bruno.buffers.transfer import to_device
from sb3_bruno.encoders import TaskEncoder, Transitions

Context = Literal["iid", "recent", "episode"]
_RING = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts", "inner_ends")


class TaskReplayBuffer(ReplayBuffer):
    """Replay buffer of transitions grouped by the task in ``info["task"]``.

    Rows are kept in a ring, as in SB3: once ``buffer_size`` transitions are in, the oldest are overwritten, of
    whatever task. A task whose last transition goes is no longer sampled.

    A sample is ``n_sequences`` tasks, drawn uniformly with replacement, with a sequence of transitions each. The
    belief at a transition is that of the transitions before it in its sequence; ``context`` says which those are:

    - ``"iid"``: drawn i.i.d. with replacement from all transitions of the task, as in the paper
    - ``"recent"``: the same, from the task's last ``n_recent`` transitions
    - ``"episode"``: what the agent had itself seen at that step, in its order (an episode whose first rows were
      overwritten begins at the first that is left). Of a ``Trial``, all its inner episodes are one

    Where an info has ``"final_observation"``, an inner episode of a trial ended, and that is the next observation.

    :param buffer_size: number of transitions, over all environments
    :param observation_space: the Dict of ``TransitionObservation``
    :param action_space: action space
    :param device: PyTorch device of the samples
    :param n_envs: number of environments
    :param optimize_memory_usage: not supported, raises
    :param handle_timeout_termination: do not treat a time limit as termination
    :param n_sequences: tasks per sample
    :param sequence_length: transitions per task in ``"iid"`` and ``"recent"`` sequences
    :param context: which transitions a belief rests on
    :param n_recent: with ``context="recent"``, how many transitions of a task count as recent
    :raises ValueError: if an argument is out of its range, or ``optimize_memory_usage`` is asked for
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
        for name, value in {
            "n_sequences": n_sequences,
            "sequence_length": sequence_length,
            "n_recent": n_recent,
        }.items():
            if value < 1:
                raise ValueError(f"`{name}` must be at least 1, got {value}.")
        if context not in ("iid", "recent", "episode"):
            raise ValueError(f"`context` must be 'iid', 'recent' or 'episode', got {context!r}.")
        super().__init__(
            buffer_size,
            observation_space["observation"],
            action_space,
            device,
            n_envs,
            handle_timeout_termination=handle_timeout_termination,
        )
        self.n_sequences = n_sequences
        self.sequence_length = sequence_length
        self.context = context
        self.n_recent = n_recent
        self.rng = np.random.default_rng(np.random.randint(2**31))  # noqa: NPY002  # which SB3 seeds
        self.tasks = TaskIndex(self.buffer_size * n_envs)
        self.episodes = EpisodeIndex(self.buffer_size, n_envs)
        self.inner_ends = np.zeros((self.buffer_size, n_envs), dtype=bool)
        self._encoder: TaskEncoder | None = None
        self._encoded: EncodedSequences | None = None

    def set_encoder(self, encoder: TaskEncoder, layout: ExtendedObs) -> None:
        """Bind what samples are made with. Neither is pickled: bind again after unpickling."""
        self._encoder = encoder
        self._layout = layout
        self.forget_beliefs()

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the encoder, and of the ring only the rows that are filled."""
        state = {key: value for key, value in self.__dict__.items() if key not in ("_encoder", "_layout", "_encoded")}
        return {**state, **{name: getattr(self, name)[: self.size()] for name in _RING}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for name in _RING:
            filled = state[name]
            ring = np.zeros((self.buffer_size, *filled.shape[1:]), dtype=filled.dtype)
            ring[: len(filled)] = filled
            setattr(self, name, ring)
        self._encoder = self._encoded = None

    def reset(self) -> None:
        super().reset()
        self.tasks = TaskIndex(self.buffer_size * self.n_envs)
        self.episodes = EpisodeIndex(self.buffer_size, self.n_envs)
        self.forget_beliefs()

    # -- storing ---------------------------------------------------------------------------------------------

    def add(  # type: ignore[override]  # observations are a Dict here, flat in the parent
        self,
        obs: dict[str, NDArray[Any]],
        next_obs: dict[str, NDArray[Any]],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Store one transition per environment.

        :raises ValueError: if an info has no ``"task"``
        """
        if not all("task" in info for info in infos):
            raise ValueError(
                'A step info has no "task": wrap the env in `sb3_bruno_envs.MetaTask`, or put the task vector there.'
            )
        self.forget_beliefs()
        first_slot = self.pos * self.n_envs
        tasks = np.array([info["task"] for info in infos], dtype=np.float32).reshape(self.n_envs, -1)
        for i, task in enumerate(tasks + np.float32(0.0)):  # which makes -0.0 and 0.0 the same task
            self.tasks.put(first_slot + i, task)
        self.episodes.put(done)
        self.inner_ends[self.pos] = ["final_observation" in info for info in infos]
        arrivals = np.array(next_obs["observation"])
        # Not done, even where the inner episode terminated: the trial goes on, and unless values flow through its inner
        # ends, as they do through a time limit, nothing is earned by finding out what only later episodes are paid for.
        for arrival, info in zip(arrivals, infos, strict=True):
            if "final_observation" in info:
                arrival[...] = info["final_observation"]
        super().add(obs["observation"], arrivals, action, reward, done, infos)

    # -- sampling --------------------------------------------------------------------------------------------

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> ReplayBufferSamples:
        """Sample transitions between extended observations.

        Consecutive calls read on in the same encoded sequences until these are used up or ``forget_beliefs`` is
        called: with 16 sequences of 64 transitions and a batch size of 256, one encode serves four calls exactly.

        :param batch_size: number of transitions, spread evenly over the sequences
        :param env: the VecNormalize, if any, that normalises as it does in the rollouts
        :return: observations and next observations (batch_size, extended dim), the rest as in SB3
        :raises RuntimeError: if the buffer is empty or no encoder is bound
        """
        n_sequences = min(self.n_sequences, batch_size)
        per_row = -(-batch_size // n_sequences)
        if self._encoded is None or not self._encoded.has(n_sequences, per_row):
            self._encoded = self._encode(n_sequences, env)
        return self._encoded.read(batch_size, per_row)

    def forget_beliefs(self) -> None:
        """The encoder, the normalisation or the data changed: encode new sequences before the next sample."""
        self._encoded = None

    def _encode(self, n_sequences: int, env: VecNormalize | None) -> EncodedSequences:
        if self._encoder is None:
            raise RuntimeError("No encoder is bound: call `set_encoder` before `sample`.")
        slots, lengths, drawn = self._context_slots(n_sequences)
        transitions = self.transitions(slots, env)
        with th.inference_mode():  # faster than no_grad; what is joined below is ordinary again, as gradients need it
            weights = self.absorbed(slots) if self.context == "episode" else None
            beliefs = self._encoder.belief(self._encoder.prefixes(transitions, weights=weights))
        tasks = self.to_torch(drawn)[:, None].expand(-1, slots.shape[1], -1)
        dones = self._flat(self.dones)[slots] * (1 - self._flat(self.timeouts)[slots])
        scalars = [self._normalize_reward(self._flat(self.rewards)[slots], env)[..., None], dones[..., None]]
        actions, rewards, done = to_device([self._flat(self.actions)[slots], *scalars], self.device)
        samples = ReplayBufferSamples(
            observations=self._layout.join(transitions.observations, beliefs[:, :-1], tasks),
            actions=actions,
            next_observations=self._layout.join(transitions.next_observations, beliefs[:, 1:], tasks),
            dones=done,
            rewards=rewards,
        )
        return EncodedSequences(samples, lengths, self.rng)

    def sample_sequences(self, n_sequences: int, env: VecNormalize | None = None) -> Transitions:
        """Sequences of transitions of one task each, exchangeable: what the encoder learns from.

        :return: transitions of shape (n_sequences, sequence_length, dim)
        :raises RuntimeError: if the buffer is empty
        """
        slots, _ = self.exchangeable_slots(n_sequences)
        return self.transitions(slots, env)

    def transitions(self, slots: Slots, env: VecNormalize | None = None) -> Transitions:
        """The transitions in ``slots`` as the agent observed them: normalised if ``env`` normalises them.

        :param slots: shape (...)
        :return: transitions of shape (..., dim)
        """
        observation: Any = self._flat(self.observations)[slots]
        arrival: Any = {
            "observation": self._flat(self.next_observations)[slots],
            "action": self._flat(self.actions)[slots],
            "reward": self._flat(self.rewards)[slots][..., None],
            "episode_start": np.zeros((*slots.shape, 1), dtype=np.float32),
        }
        if env is not None and env.norm_obs:
            observation = env.normalize_obs({**arrival, "observation": observation})["observation"]
            arrival = env.normalize_obs(arrival)
        parts = [observation, arrival["action"], arrival["reward"], arrival["observation"]]
        return Transitions(*to_device([one.reshape(*slots.shape, -1) for one in parts], self.device))

    def absorbed(self, slots: Slots) -> th.Tensor:
        """1 where an agent absorbs the transition in its slot, 0 where not, shape (...).

        It never absorbs the last one of an inner episode: the observation that comes next begins another one.
        """
        return self.to_torch(~self._flat(self.inner_ends)[slots]).float()

    # -- which slots -----------------------------------------------------------------------------------------

    def _flat(self, array: NDArray[Any]) -> NDArray[Any]:
        """A view with one slot per row: (rows, n_envs, ...) -> (rows * n_envs, ...); slot = row * n_envs + env."""
        return array.reshape(-1, *array.shape[2:])

    def _context_slots(self, n_sequences: int) -> tuple[Slots, Slots, NDArray[np.float32]]:
        """Slots (n_sequences, time), how many of each row are real (n_sequences,), tasks (n_sequences, task_dim)."""
        if self.context != "episode":
            slots, tasks = self.exchangeable_slots(n_sequences)
            return slots, np.full(n_sequences, slots.shape[1]), tasks
        queues = self._draw_tasks(n_sequences)
        drawn = np.array([queue.slots[self.rng.integers(len(queue))] for queue in queues], dtype=np.int64)
        slots, lengths = self.episodes.holding(drawn)
        return slots, lengths, np.stack([queue.task for queue in queues])

    def exchangeable_slots(self, n_sequences: int) -> tuple[Slots, NDArray[np.float32]]:
        """Slots drawn i.i.d. within each task (n_sequences, sequence_length), tasks (n_sequences, task_dim)."""
        queues = self._draw_tasks(n_sequences)
        fractions = self.rng.random((n_sequences, self.sequence_length))
        slots = np.empty(fractions.shape, dtype=np.int64)
        for row, queue in enumerate(queues):
            pool = queue.slots[-self.n_recent :] if self.context == "recent" else queue.slots
            slots[row] = pool[(fractions[row] * len(pool)).astype(np.int64)]
        return slots, np.stack([queue.task for queue in queues])

    def _draw_tasks(self, n_sequences: int) -> list[SlotQueue]:
        if len(self.tasks) == 0:
            raise RuntimeError("The replay buffer is empty: collect transitions before sampling.")
        return self.tasks.draw(n_sequences, self.rng)
