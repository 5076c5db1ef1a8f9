"""An encoder without an agent, for the benchmarks of beliefs: data of a fixed behaviour, and updates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch as th
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoEncoder, BrunoSAC, TaskReplayBuffer


def random_transitions(env_id: str, n: int, seed: int, sequence_length: int, **env_kwargs: Any) -> TaskReplayBuffer:
    """So many transitions of random actions, ten envs."""
    env = make_vec_env(f"sb3_bruno_envs:{env_id}", 10, seed=seed, env_kwargs=env_kwargs)
    kwargs = {"sequence_length": sequence_length}
    model = BrunoSAC("MlpPolicy", env, seed=seed, learning_starts=n + 1, buffer_size=n, replay_buffer_kwargs=kwargs)
    return model.learn(n).replay_buffer


def updates(
    encoder: BrunoEncoder, buffer: TaskReplayBuffer, n_updates: int, n_sequences: int, learning_rate: float
) -> Iterator[float]:
    """Train, and give the bound at every update, in nats per transition."""
    optimizer = th.optim.Adam(encoder.parameters(), lr=learning_rate)
    for _ in range(n_updates):
        bound = encoder.train().bound(buffer.sample_sequences(n_sequences))
        optimizer.zero_grad()
        (-bound).backward()
        optimizer.step()
        yield bound.item()
