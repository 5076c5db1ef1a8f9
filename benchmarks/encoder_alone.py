"""Train and read out an encoder without an agent, on data of random actions, for the benchmarks of beliefs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch as th
from numpy.typing import NDArray
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoSAC, TaskReplayBuffer
from sb3_bruno.encoders import Loss, TaskEncoder, TaskSequences


def random_transitions(env_id: str, n: int, seed: int, sequence_length: int, **env_kwargs: Any) -> TaskReplayBuffer:
    """Collect ``n`` transitions of random actions in ten environments."""
    env = make_vec_env(f"sb3_bruno_envs:{env_id}", 10, seed=seed, env_kwargs=env_kwargs)
    kwargs = {"sequence_length": sequence_length}
    model = BrunoSAC("MlpPolicy", env, seed=seed, learning_starts=n + 1, buffer_size=n, replay_buffer_kwargs=kwargs)
    return model.learn(n).replay_buffer


def updates(
    encoder: TaskEncoder, draw: Callable[[], TaskSequences], n_updates: int, learning_rate: float
) -> Iterator[Loss]:
    """Train an encoder with a loss of its own on the sequences that ``draw`` returns, and yield each update's loss."""
    optimizer = th.optim.Adam(encoder.parameters(), lr=learning_rate)
    for _ in range(n_updates):
        loss = encoder.train().loss(draw())
        assert loss is not None, f"{type(encoder).__name__} learns from others"
        optimizer.zero_grad()
        loss.total.backward()
        if encoder.max_grad_norm is not None:
            th.nn.utils.clip_grad_norm_(encoder.parameters(), encoder.max_grad_norm)
        optimizer.step()
        yield loss


def read_out(means: NDArray[np.float32], targets: NDArray[Any], n_fit: int) -> NDArray[np.float64]:
    """Predict targets by a linear function of posterior means, fitted on the first ``n_fit`` sequences.

    Args:
        means: ``(n, latent_dim)``.
        targets: what to predict, ``(n,)`` or ``(n, dim)``.
        n_fit: how many sequences to fit the function on.

    Returns:
        The predictions for the other sequences, ``(n - n_fit,)`` or ``(n - n_fit, dim)``.
    """
    inputs = np.c_[means, np.ones(len(means))]
    weights, *_ = np.linalg.lstsq(inputs[:n_fit], targets[:n_fit])
    predictions: NDArray[np.float64] = inputs[n_fit:] @ weights
    return predictions


def explained(
    known: tuple[NDArray[np.float32], NDArray[Any]], tested: tuple[NDArray[np.float32], NDArray[Any]]
) -> float:
    """Measure the share of the tasks' variance that a linear read-out of posterior means explains.

    Args:
        known: means ``(n, latent_dim)`` and tasks ``(n, dim)`` that the read-out is fitted on.
        tested: those of other tasks.
    """
    means, tasks = (np.concatenate(parts) for parts in zip(known, tested, strict=True))
    errors = read_out(means, tasks, len(known[0])) - tested[1]
    return float(1 - (errors**2).sum() / ((tested[1] - tested[1].mean(axis=0)) ** 2).sum())
