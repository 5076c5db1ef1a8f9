"""Runs the first step of an agent as it is loaded, while what it may cost is limited: no later step costs more."""

from __future__ import annotations

import torch as th
from gymnasium.spaces import flatdim

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import Predicts, Transitions


def run_first_step(model: TaskInference) -> None:
    """Infer from one transition and read the task. What actor and critics cost is that of their weights.

    Raises:
        ValueError: if what is read is not finite: weights may be finite, and yet as large as that.
        Exception: of any kind, where it costs more than a budget around it allows, or cannot be computed.
    """
    policy, encoder = model.policy, model.policy.encoder
    observation_dim = flatdim(policy.observation_space["observation"])
    dims = (observation_dim, flatdim(policy.action_space), 1, observation_dim)
    zeros = Transitions(*(th.zeros(1, dim, device=policy.device) for dim in dims))
    with th.random.fork_rng(devices=[]), th.no_grad():
        memory = encoder.absorb(encoder.start_episode(encoder.empty((1,))), zeros)
        encoder.belief(memory)
        if policy.forget_threshold is not None and isinstance(encoder, Predicts):
            encoder.log_bayes_factor(memory, zeros)
        if policy.readout is not None:
            reading = policy.readout.read(encoder, memory)
            if not (reading.mean.isfinite().all() and reading.std.isfinite().all()):
                raise ValueError("its read-out tells a task that is not finite")
