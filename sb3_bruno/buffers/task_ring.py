"""A ring of transitions grouped by task and by episode: what is stored, and which slots hold what.

It knows no encoder and no belief.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.buffers.distinct import distinct_places
from sb3_bruno.buffers.episode_index import EpisodeIndex, Slots
from sb3_bruno.buffers.long_episodes import EpisodeRows, shortened, whole
from sb3_bruno.buffers.numbers import check_numbers, place_in_env, read_rows
from sb3_bruno.buffers.observed import TransitionArrays, normalize
from sb3_bruno.buffers.random_generator import random_generator
from sb3_bruno.buffers.task_index import TaskIndex
from sb3_bruno.buffers.transfer import to_device
from sb3_bruno.buffers.uninterrupted import uninterrupted
from sb3_bruno.encoders import Transitions

_RING = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts", "inner_ends")


class TaskRing(ReplayBuffer):
    """Stores transitions in a ring, grouped by the task in ``info["task"]``.

    Once ``buffer_size`` transitions are in, the oldest are overwritten, of whatever task. A task whose last transition
    goes is no longer drawn. Where an info has ``"trial_final_observation"``, an inner episode of a trial ended: there
    the transition led, and what the agent was shown next begins another inner episode.

    Args:
        buffer_size: number of transitions, over all environments.
        observation_space: the Dict of ``TransitionObservation``.
        action_space: action space.
        device: PyTorch device of what is gathered.
        n_envs: number of environments.
        handle_timeout_termination: do not treat a time limit as termination.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Dict,
        action_space: spaces.Space[Any],
        device: th.device | str,
        n_envs: int,
        handle_timeout_termination: bool,
    ) -> None:
        super().__init__(
            buffer_size,
            observation_space["observation"],
            action_space,
            device,
            n_envs,
            handle_timeout_termination=handle_timeout_termination,
        )
        self.rng = random_generator()
        self.tasks = TaskIndex(self.buffer_size * n_envs)
        self.episodes = EpisodeIndex(self.buffer_size, n_envs)
        self.inner_ends = np.zeros((self.buffer_size, n_envs), dtype=bool)
        self._restarts: dict[int, NDArray[Any]] = {}  # by slot: the observation that begins the next inner episode

    def __getstate__(self) -> dict[str, Any]:
        """Keep only the rows of the ring that are filled."""
        return {**self.__dict__, **{name: getattr(self, name)[: self.size()] for name in _RING}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for name in _RING:
            filled = state[name]
            ring = np.zeros((self.buffer_size, *filled.shape[1:]), dtype=filled.dtype)
            ring[: len(filled)] = filled
            setattr(self, name, ring)

    def reset(self) -> None:
        super().reset()
        self.tasks = TaskIndex(self.buffer_size * self.n_envs)
        self.episodes = EpisodeIndex(self.buffer_size, self.n_envs)
        self._restarts = {}

    def add(
        self,
        obs: dict[str, NDArray[Any]] | NDArray[Any],
        next_obs: dict[str, NDArray[Any]] | NDArray[Any],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Store one transition per environment, or none if one of them is refused.

        An observation is the env's Dict, or its entry ``"observation"`` alone, as the buffer holds it.

        Raises:
            ValueError: if an info has no ``"task"``, or one of another size; if an array has another shape; or if a
                number is not finite, or so large that what learns from it would not be.
        """
        tasks, rows = self._read_tasks(infos), (self.n_envs, *self.obs_shape)
        departures = read_rows("obs['observation']", _entry(obs), rows)
        shown = read_rows("next_obs['observation']", _entry(next_obs), rows)
        in_shape = (self.n_envs, *(self.action_space.shape or ()))
        action = read_rows("action", action, (self.n_envs, self.action_dim), in_shape)
        reward, done = read_rows("reward", reward, (self.n_envs,)), read_rows("done", done, (self.n_envs,))
        arrivals = np.array(shown)
        inner_ends = [i for i, info in enumerate(infos) if "trial_final_observation" in info]
        for i in inner_ends:
            final = infos[i]["trial_final_observation"]
            arrivals[i] = read_rows("info['trial_final_observation']", final, self.obs_shape)
        numbers = {"observation": departures, "action": action, "reward": reward, "task": tasks}
        check_numbers(numbers | {"next observation": arrivals}, self._place)
        row, first_slot = self.pos, self.pos * self.n_envs
        with uninterrupted():  # half of it would shift all that follows by a row
            # Not done, even where an inner episode terminated: the trial goes on from where the next begins. Unless
            # values flow through its inner ends, nothing is earned by finding out what only later ones are paid for.
            super().add(departures, arrivals, action, reward, done, infos)
            for slot, task in enumerate(tasks, first_slot):
                self.tasks.put(slot, task)
                self._restarts.pop(slot, None)
            self.episodes.put(done)
            self.inner_ends[row] = False
            self.inner_ends[row, inner_ends] = True
            self._restarts.update({first_slot + i: shown[i].copy() for i in inner_ends})

    def _read_tasks(self, infos: list[dict[str, Any]]) -> NDArray[np.float32]:
        """Read the tasks off the infos, (n_envs, task_dim)."""
        if len(infos) != self.n_envs:
            raise ValueError(f"`infos` has {len(infos)} entries: give one for each of the {self.n_envs} envs.")
        for i, info in enumerate(infos):
            if "task" not in info:
                raise ValueError(
                    f'The step info of env {i} has no "task": wrap the env in `sb3_bruno_envs.MetaTask`, or put the '
                    "task vector there."
                )
        tasks = [np.ravel(np.asarray(info["task"], dtype=np.float32)) for info in infos]
        task_dim = len(tasks[0]) if self.tasks.task_dim is None else self.tasks.task_dim
        for i, task in enumerate(tasks):
            if len(task) != task_dim:
                raise ValueError(f"The task of env {i} is {task}, and others have {task_dim} numbers: give as many.")
        return np.stack(tasks) + np.float32(0.0)  # which makes -0.0 and 0.0 the same task

    def last_tasks(self) -> NDArray[np.float32]:
        """Return the tasks of what was stored last, (n_envs, task_dim)."""
        first_slot = (self.pos - 1) % self.buffer_size * self.n_envs
        numbers = [self.tasks.number_of(slot) for slot in range(first_slot, first_slot + self.n_envs)]
        return self.tasks.tasks(np.array(numbers))

    def _place(self, index: tuple[int, ...]) -> str:
        """Say where an entry (env, ...) of what is added comes from."""
        return f"{place_in_env(index)}, at step {self.episodes.lengths[index[0]]} of its episode"

    # -- which slots -----------------------------------------------------------------------------------------

    def exchangeable_slots(
        self, n_sequences: int, length: int, n_recent: int | None = None
    ) -> tuple[Slots, NDArray[np.float32]]:
        """Draw slots uniformly within tasks, which are drawn uniformly with replacement.

        Within a task no slot is drawn twice, so that no belief rests on the transition that it is used at; a task that
        has fewer than ``length`` gives them with replacement.

        Args:
            n_sequences: number of tasks.
            length: slots per task.
            n_recent: draw from the last so many transitions of a task; None: from all.

        Returns:
            Slots (n_sequences, length) and tasks (n_sequences, task_dim).
        """
        numbers = self._draw_tasks(n_sequences, self.rng)
        counts = self.tasks.counts(numbers)
        pools = counts if n_recent is None else np.minimum(counts, n_recent)
        places = (counts - pools)[:, None] + distinct_places(pools, length, self.rng)
        return self.tasks.slots(numbers, places), self.tasks.tasks(numbers)

    def episode_rows(
        self, n_sequences: int, *, bounded: bool, rng: np.random.Generator | None = None
    ) -> tuple[EpisodeRows, NDArray[np.float32]]:
        """Draw an episode each of tasks drawn uniformly with replacement, long ones more often than short ones.

        Args:
            n_sequences: number of tasks.
            bounded: whether to take only so many steps of long episodes that a belief may still rest on all of them.
            rng: draws them; None: the buffer's own.

        Returns:
            The steps (n_sequences, time), and the tasks (n_sequences, task_dim).
        """
        rng = self.rng if rng is None else rng
        numbers = self._draw_tasks(n_sequences, rng)
        drawn = self.tasks.slots(numbers, rng.integers(self.tasks.counts(numbers)))
        slots, lengths = self.episodes.holding(drawn)
        rows = shortened(slots, lengths, drawn, rng) if bounded else whole(slots, lengths)
        return rows, self.tasks.tasks(numbers)

    def _draw_tasks(self, n_sequences: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw the numbers of tasks, (n_sequences,)."""
        if len(self.tasks) == 0:
            raise RuntimeError("The replay buffer is empty: collect transitions before sampling.")
        return self.tasks.draw(n_sequences, rng)

    # -- what they hold --------------------------------------------------------------------------------------

    def transitions(self, slots: Slots, env: VecNormalize | None = None) -> Transitions:
        """Gather the transitions in ``slots`` as the agent observed them: normalised if ``env`` normalises them.

        Args:
            slots: shape (...).
            env: the VecNormalize, if any.

        Returns:
            Transitions of shape (..., dim).
        """
        return Transitions(*to_device(self.observed(slots, env), self.device))

    def observed(self, slots: Slots, env: VecNormalize | None) -> list[NDArray[Any]]:
        """Gather s, a, r and s' in ``slots`` as the agent observed them, as flat arrays (..., dim)."""
        return [array.reshape(*slots.shape, -1) for array in normalize(self._stored(slots), env)]

    def restarts(self, slots: Slots, env: VecNormalize | None) -> NDArray[Any]:
        """Gather the observations that begin another inner episode after those that ended in ``slots`` (n,), flat."""
        begun = np.stack([self._restarts[slot] for slot in slots.tolist()])
        observed = normalize(self._stored(slots)._replace(next_observations=begun), env)
        return observed.next_observations.reshape(len(slots), -1)

    def _stored(self, slots: Slots) -> TransitionArrays:
        return TransitionArrays(
            self.flat(self.observations)[slots],
            self.flat(self.actions)[slots],
            self.flat(self.rewards)[slots][..., None],
            self.flat(self.next_observations)[slots],
        )

    def absorbed(self, slots: Slots) -> NDArray[np.bool_]:
        """Tell in which slots (...) there are transitions that the agent absorbed.

        It never absorbs the last one of an inner episode: the observation that comes next begins another one.
        """
        absorbed: NDArray[np.bool_] = ~self.flat(self.inner_ends)[slots]
        return absorbed

    def flat(self, array: NDArray[Any]) -> NDArray[Any]:
        """View a ring with one slot per row: (rows, n_envs, ...) -> (rows * n_envs, ...); slot = row * n_envs + env."""
        return array.reshape(-1, *array.shape[2:])


def _entry(observation: dict[str, NDArray[Any]] | NDArray[Any]) -> NDArray[Any]:
    """Return the env's own observation."""
    return observation["observation"] if isinstance(observation, dict) else observation
