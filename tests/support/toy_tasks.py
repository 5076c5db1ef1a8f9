"""Sequences of a toy task that tells itself in rewards, training on them, and how much a belief then knows."""

import numpy as np
import torch as th

from sb3_bruno.encoders import TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory

TIME = 8


def toy_sequences(n=64, seed=0):
    """The task, -1 or 1, is the reward's sign: r = task * (1.5 + a). The last two transitions are padding in half."""
    generator = th.Generator().manual_seed(seed)
    observations, actions, arrivals = (th.randn(n, TIME, dim, generator=generator) for dim in (3, 2, 3))
    tasks = th.where(th.arange(n) % 2 == 0, 1.0, -1.0)[:, None]
    rewards = tasks[:, None] * (1.5 + 0.5 * actions[..., :1].tanh())
    weights = th.ones(n, TIME)
    weights[: n // 2, -2:] = 0
    return TaskSequences(Transitions(observations, actions, rewards, arrivals), tasks, weights)


def trained(encoder, n_updates=80, tasks_of=lambda tasks: tasks):
    """The encoder after as many updates by its own loss. ``tasks_of`` says how tasks are told to it."""
    th.manual_seed(0)
    optimizer = th.optim.Adam(encoder.parameters(), lr=1e-2)
    for seed in range(n_updates):
        sequences = toy_sequences(16, seed)
        optimizer.zero_grad()
        encoder.loss(sequences._replace(tasks=tasks_of(sequences.tasks))).total.backward()
        optimizer.step()
    return encoder.eval()


@th.no_grad()
def memory_after(encoder, n_steps, seed=1_000):
    """The memories of held-out sequences after some steps, and their tasks (n,)."""
    transitions, tasks, weights = toy_sequences(seed=seed)
    memory = map_memory(lambda prefixes: prefixes[:, n_steps], encoder.prefixes(transitions, weights))
    return memory, tasks[:, 0]


def explained(encoder, n_steps):
    """The share of the task's variance that a linear function of the belief explains after some steps."""
    memory, tasks = memory_after(encoder, n_steps)
    x = np.column_stack([encoder.belief(memory).detach().numpy(), np.ones(len(tasks))])
    fitted = x @ np.linalg.lstsq(x, tasks.numpy(), rcond=1e-4)[0]
    return 1 - np.var(tasks.numpy() - fitted) / np.var(tasks.numpy())
