"""How time and memory grow with the number of tasks, the length of histories and the number of weights."""

from __future__ import annotations

import tracemalloc
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th

from sb3_bruno import BrunoEncoder, TaskReplayBuffer, Transitions
from sb3_bruno.buffers.extended_obs import ExtendedObs
from sb3_bruno_envs import TaskSet
from speed_sections.models import ACTION_DIM, ENV_ID, KERNEL, OBSERVATION_DIM, trained
from speed_sections.race import Row, Seconds, race, row


def filled(
    n_tasks: int, n_transitions: int = 200_000, n_envs: int = 100, episode: int | None = None, **kwargs: Any
) -> TaskReplayBuffer:
    """Fill a buffer with transitions of so many tasks in turn, and bind the default encoder of rewards.

    Args:
        n_tasks: number of tasks.
        n_transitions: how many it holds.
        n_envs: how many are stored at a time.
        episode: the length of episodes, of which all envs begin one at once; None: they never end.
        **kwargs: further arguments of the buffer.
    """
    space = gym.make(ENV_ID).observation_space
    buffer = TaskReplayBuffer(n_transitions, space, gym.spaces.Box(-1, 1, (ACTION_DIM,)), "cpu", n_envs, **kwargs)
    tasks = np.arange(n_tasks, dtype=np.float32)[:, None]
    observation = {"observation": np.zeros((n_envs, OBSERVATION_DIM), dtype=np.float32)}
    zeros, actions = np.zeros(n_envs), np.zeros((n_envs, ACTION_DIM), dtype=np.float32)
    for step in range(n_transitions // n_envs):
        began = step if episode is None else step // episode
        infos = [{"task": tasks[(began * n_envs + env) % n_tasks]} for env in range(n_envs)]
        dones = np.full(n_envs, episode is not None and step % episode == episode - 1)
        buffer.add(observation, observation, actions, zeros, dones, infos)
    encoder = BrunoEncoder(OBSERVATION_DIM, ACTION_DIM, **KERNEL["encoder_kwargs"]).eval()
    buffer.set_encoder(encoder, ExtendedObs(OBSERVATION_DIM, encoder.belief_dim, 1))
    return buffer


def sample(buffer: TaskReplayBuffer, batch: int) -> None:
    """Sample with an encode."""
    buffer.forget_beliefs()
    buffer.sample(batch)


def sampling(rounds: int) -> tuple[list[Row], Seconds]:
    """Time samples of 256 with their beliefs, and draws of a ``TaskSet``, for few and many tasks."""
    counts = (2, 1_000, 100_000)
    buffers = {f"{n:,} tasks": filled(n) for n in counts}
    seconds = race({name: partial(sample, buffer, 256) for name, buffer in buffers.items()}, rounds, 10)
    rows = [row(f"sample of 256, {name}", seconds, name, "2 tasks", "flat") for name in buffers]
    sets = {f"{n:,} tasks": TaskSet(np.arange(n, dtype=np.float32)[:, None]) for n in counts}
    rng = np.random.default_rng(0)
    draws = race({name: partial(tasks.draw, rng) for name, tasks in sets.items()}, rounds, 1_000)
    rows += [row(f"draw of a TaskSet, {name}", draws, name, "2 tasks", "flat") for name in sets]
    return rows, seconds | {f"draw, {name}": times for name, times in draws.items()}


def episodes(rounds: int) -> tuple[list[Row], Seconds]:
    """Time a sample of 128 with its encode of whole episodes, by their length."""
    lengths = (200, 384, 1_000)
    buffers = {f"{n:,} steps": filled(2, 20 * n, 20, n, context="episode", n_sequences=16) for n in lengths}
    seconds = race({name: partial(sample, buffer, 128) for name, buffer in buffers.items()}, rounds, 5)
    return [row(f"encode of episodes of {name}", seconds, name, "200 steps", "<= 2") for name in buffers], seconds


def growth(rounds: int) -> tuple[list[Row], Seconds]:
    """Time all beliefs of a history by its length, and an encoder update by the number of weights."""
    encoder = BrunoEncoder(OBSERVATION_DIM, ACTION_DIM).eval()

    def prefixes(history: Transitions) -> None:
        with th.no_grad():
            encoder.belief(encoder.prefixes(history))

    dims = (OBSERVATION_DIM, ACTION_DIM, 1, OBSERVATION_DIM)
    histories = {
        f"{time:,} steps": Transitions(*(th.randn(1, time, dim) for dim in dims)) for time in (100, 1_000, 10_000)
    }
    lengths = race({name: partial(prefixes, history) for name, history in histories.items()}, rounds, 5)
    rows = [row(f"all beliefs of {name}", lengths, name, "100 steps", "linear") for name in lengths]
    models = {f"{n} weights": trained(encoder_kwargs={"n_weights": n}) for n in (4, 8, 16, 32)}
    updates = race({name: model._update_encoder for name, model in models.items()}, rounds, 3)
    return rows + [row(f"encoder update, {name}", updates, name, "8 weights") for name in updates], lengths | updates


def memory(_rounds: int) -> tuple[list[Row], Seconds]:
    """Count the bytes of a full buffer of 200,000 cheetah transitions beside those of the transitions themselves."""
    rows = []
    for n_tasks in (100, 100_000):
        tracemalloc.start()
        buffer = filled(n_tasks)
        used, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        names = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
        ratio = used / sum(getattr(buffer, name).nbytes for name in names)
        what = f"bytes of 200,000 transitions of {n_tasks:,} tasks"
        rows.append(Row(what, 0, "their own", ratio, ratio, ratio, "<= 1.2"))
    return rows, {}
