"""Learns what weights a task has, so that a belief over weights tells how likely any task is."""

from __future__ import annotations

import torch as th
from torch import Tensor, nn
from zuko.nn import MLP

from sb3_bruno.maths.kernel_process import KernelGaussian
from sb3_bruno.maths.kernel_statistics import KernelStatistics
from sb3_bruno.maths.standardize import Standardize

LEAST_SLACK = 1e-6
"""The least variance of the weights of a known task; with less, the digits of float64 do not suffice."""

RATE = 0.02
"""How far an update moves the slack towards what one batch says."""


class TaskMap(nn.Module):
    r"""Creates a map from tasks to the weights of a process with a kernel, with slack for what it cannot tell.

    .. math:: w \mid g \sim N(\psi(g), \text{diag } \tau)

    Then the likelihood of a task g follows from the statistics of a set in closed form, and so does the posterior over
    any candidates. The posterior is in the task's own units, and may have several modes. The map learns from the true
    tasks of training; it teaches the encoder's networks nothing. Its slack follows in closed form, by EM: a gradient
    step of Adam's moves a logarithm by its rate, and slack may have to fall by many orders of magnitude.

    Args:
        task_dim: size of the task vector.
        n_weights: K, the number of weights.
        hidden_size: width of the two hidden layers of psi.
    """

    def __init__(self, task_dim: int, n_weights: int, hidden_size: int = 64) -> None:
        super().__init__()
        self.standardize = Standardize(task_dim)
        self.psi = MLP(task_dim, n_weights, (hidden_size, hidden_size), activation=nn.SiLU)
        self.register_buffer("log_slack", th.zeros(n_weights))

    log_slack: Tensor

    @property
    def slack(self) -> Tensor:
        """tau, the variances of the weights of a known task, ``(K,)``."""
        return LEAST_SLACK + self.log_slack.exp()

    @th.no_grad()
    def update(self, process: KernelGaussian, statistics: KernelStatistics, tasks: Tensor) -> None:
        """Move the slack towards what sets ``(batch, size)`` of known tasks ``(batch, task_dim)`` say of it."""
        self.standardize.update(tasks)
        expected = self.psi(self.standardize(tasks)).unsqueeze(-2)
        spread = process.spread_under(statistics, expected, self.slack).mean(dim=(0, 1))
        self.log_slack.copy_(self.log_slack.double().exp().lerp(spread, RATE).clamp(min=LEAST_SLACK).log())

    def log_likelihood(self, process: KernelGaussian, statistics: KernelStatistics, tasks: Tensor) -> Tensor:
        """Return log p(set | task) in nats for each of several tasks.

        Args:
            process: that joins the set.
            statistics: of the set, ``(..., size)``.
            tasks: ``(..., n, task_dim)``.

        Returns:
            ``(..., n)``, in float64.
        """
        return process.log_evidence_under(statistics, self.psi(self.standardize(tasks)), self.slack)
