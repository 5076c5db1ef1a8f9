"""Samples episodes as the agent met them, for whoever learns from them without a part in the agent's own learning."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.buffers.spared_tasks import spared_tasks
from sb3_bruno.buffers.task_buffer import TaskReplayBuffer
from sb3_bruno.encoders import TaskSequences


class SampledEpisodes(NamedTuple):
    """Episodes of one task each.

    Attributes:
        sequences: their transitions and tasks, (n, time, dim) and (n, task_dim).
        is_read: at which steps the belief is that of all steps before, (n, time).
        is_spared: of which tasks a read-out must learn nothing but how wide its intervals are, (n,): of one task in
            five, none at the ends of a range (``spared_tasks``), and of none while there are fewer than five.
    """

    sequences: TaskSequences
    is_read: NDArray[np.bool_]
    is_spared: NDArray[np.bool_]


def sample_episodes(
    buffer: TaskReplayBuffer, n_episodes: int, *, bounded: bool, rng: np.random.Generator, env: VecNormalize | None
) -> SampledEpisodes:
    """Sample episodes of tasks drawn uniformly, with random numbers that are not the buffer's own.

    Args:
        buffer: where they are stored.
        n_episodes: how many.
        bounded: whether to take only so much of long ones as a belief in any order may still rest on.
        rng: draws them.
        env: the VecNormalize, if any, that normalises as it does in the rollouts.

    Raises:
        RuntimeError: if the buffer is empty.
    """
    rows, tasks = buffer.episode_rows(n_episodes, bounded=bounded, rng=rng)
    held = buffer.tasks.held()
    spared = held[spared_tasks(buffer.tasks.tasks(held), buffer.tasks.checksums(held))]
    is_spared = np.isin(np.array([buffer.tasks.find(task) for task in tasks], dtype=np.int64), spared)
    return SampledEpisodes(buffer.sequences(rows, tasks, env), rows.is_read, is_spared)
