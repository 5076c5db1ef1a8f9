"""Reads the task off what an encoder keeps, for people: a small head on any encoder, which teaches the encoder nothing.

Where the training tasks are few, the head tells how probable each of them is; elsewhere it tells a density over tasks.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch as th
from torch import Tensor, nn
from torch.distributions import Categorical, MixtureSameFamily
from torch.nn import functional as F
from zuko.nn import MLP

from sb3_bruno.encoders.abilities import HasPosterior
from sb3_bruno.encoders.base import TaskEncoder, Transitions, map_memory
from sb3_bruno.encoders.task_heads import GaussianHead, mixture_of_gaussians
from sb3_bruno.maths.standardize import Standardize

N_COMPONENTS = 4
"""Gaussians of a density over tasks: where a belief goes round in a circle, the far ends of a task meet."""
LARGEST_LOG_VAR = 20.0
"""Nats up to which the log of a variance is read: a Student-t's may be infinite."""


class Reading(NamedTuple):
    """What a read-out takes the task for, in the task's own units, batch shape (...).

    Attributes:
        mean: (..., task_dim).
        std: standard deviation of each entry, (..., task_dim).
        probabilities: of each of the few tasks, (..., n_tasks); None where tasks are not few.
    """

    mean: Tensor
    std: Tensor
    probabilities: Tensor | None


class TaskReadout(nn.Module, ABC):
    """Creates a read-out: three hidden layers and a linear path beside them, on standardised features of a memory.

    Args:
        feature_dim: size of ``features``.
        hidden_size: width of the hidden layers.
    """

    def __init__(self, feature_dim: int, hidden_size: int = 128) -> None:
        super().__init__()
        self.standardize = Standardize(feature_dim)
        self.network = MLP(feature_dim, hidden_size, (hidden_size, hidden_size), activation=nn.SiLU)
        self.joined_dim = feature_dim + hidden_size

    @staticmethod
    def features(encoder: TaskEncoder, memory: Any) -> Tensor:
        """Return what is read, (..., feature_dim): mean and log-variance of the posterior; without them, the belief."""
        if not isinstance(encoder, HasPosterior):
            return encoder.belief(memory)
        posterior = encoder.posterior(memory)
        try:
            mean, var = posterior.mean, posterior.variance
        except NotImplementedError:  # of a distribution that knows them not, such as a flow's
            return encoder.belief(memory)
        log_var = var.clamp(min=th.finfo(th.float32).tiny).log()
        return th.cat([mean, log_var.clamp(-LARGEST_LOG_VAR, LARGEST_LOG_VAR)], dim=-1)

    @classmethod
    def prefix_features(
        cls, encoder: TaskEncoder, transitions: Transitions, weights: Tensor | None, lengths: Tensor
    ) -> Tensor:
        """Return the features of the first so many transitions, (batch, n, feature_dim).

        The memories, which may be large, are made only where there is a posterior to read off them.

        Args:
            encoder: reads the transitions.
            transitions: shape (batch, time, dim).
            weights: as ``prefixes`` of the encoder takes them, (batch, time).
            lengths: how many transitions, 0 to time, (batch, n), int64.
        """

        def chosen(states: Tensor) -> Tensor:
            return states.take_along_dim(lengths.reshape(*lengths.shape, *[1] * (states.ndim - 2)), dim=1)

        if isinstance(encoder, HasPosterior):
            return cls.features(encoder, map_memory(chosen, encoder.prefixes(transitions, weights)))
        no_noise = encoder.empty((len(lengths), 1))
        return chosen(encoder.prefix_beliefs(transitions, weights, no_noise))

    def read(self, encoder: TaskEncoder, memory: Any) -> Reading:
        """Read the task off a memory, batch shape (...)."""
        reading: Reading = self(self.features(encoder, memory))
        return reading

    @abstractmethod
    def forward(self, features: Tensor) -> Reading:
        """Read the task off features (..., feature_dim)."""

    @abstractmethod
    def loss(self, features: Tensor, tasks: Tensor, counts: Tensor, is_spared: Tensor) -> Tensor:
        """Return what to minimise to tell the true tasks. In training mode, move the running statistics too.

        Args:
            features: without gradient, (batch, time, feature_dim).
            tasks: (batch, task_dim).
            counts: whether each counts, (batch, time).
            is_spared: which tasks tell how wide the intervals must be, (batch, 1): what is read must not fit them.

        Returns:
            Shape ().
        """

    @abstractmethod
    def error(self, reading: Reading, tasks: Tensor) -> Tensor:
        """Tell how far readings (batch, ...) are off the tasks (batch, ..., task_dim), (batch, ...); 0 is perfect."""

    def _joined(self, features: Tensor) -> Tensor:
        standard = self.standardize(features)
        return th.cat([standard, F.silu(self.network(standard))], dim=-1)


class DensityReadout(TaskReadout):
    """Creates a read-out of tasks of any kind: a mixture of Gaussians, as wide as its misses on tasks it did not fit.

    The tasks that are spared teach nothing but one number per entry, by which all standard deviations are multiplied.
    Without it a head that has learned a few tasks by heart is sure of each, and of the nearest of them where the task
    is new.

    Args:
        feature_dim: size of ``features``.
        task_dim: size of the task vector.
    """

    def __init__(self, feature_dim: int, task_dim: int) -> None:
        super().__init__(feature_dim)
        self.head = GaussianHead(self.joined_dim, task_dim, N_COMPONENTS)
        self.log_widen = nn.Parameter(th.zeros(task_dim))

    def forward(self, features: Tensor) -> Reading:
        told = self._widened(*_parts(self._fitted(features)))
        return Reading(told.mean, told.stddev, None)

    def loss(self, features: Tensor, tasks: Tensor, counts: Tensor, is_spared: Tensor) -> Tensor:
        if self.training:
            self.standardize.update(features)
            self.head.update(tasks)
        wanted = tasks.unsqueeze(-2)
        # Not widened: else the head would learn to be as much too sure as it is widened.
        fitted = self._fitted(features)
        widened = self._widened(*(part.detach() for part in _parts(fitted)))
        nats = th.where(is_spared, widened.log_prob(wanted), fitted.log_prob(wanted))
        return -(counts * nats).sum() / counts.sum().clamp(min=1)

    def error(self, reading: Reading, tasks: Tensor) -> Tensor:
        """Return the root mean square of the miss over the entries, where 1 is as much as the tasks vary."""
        miss = (reading.mean - tasks) / self.head.standardize.std
        return miss.square().mean(dim=-1).sqrt()

    def _fitted(self, features: Tensor) -> MixtureSameFamily:
        told: MixtureSameFamily = self.head(self._joined(features))
        return told

    def _widened(self, logits: Tensor, means: Tensor, stds: Tensor) -> MixtureSameFamily:
        return mixture_of_gaussians(logits, means, stds * self.log_widen.exp())


def _parts(mixture: MixtureSameFamily) -> tuple[Tensor, Tensor, Tensor]:
    """Return logits, means and standard deviations, as ``mixture_of_gaussians`` takes them."""
    components: Any = mixture.component_distribution
    return mixture.mixture_distribution.logits, components.base_dist.loc, components.base_dist.scale


class ListReadout(TaskReadout):
    """Creates a read-out of few tasks: how probable each of a list is.

    Args:
        feature_dim: size of ``features``.
        tasks: the list, (n_tasks, task_dim).
    """

    tasks: Tensor

    def __init__(self, feature_dim: int, tasks: Tensor) -> None:
        super().__init__(feature_dim)
        self.register_buffer("tasks", tasks)
        self.logits = nn.Linear(self.joined_dim, len(tasks))

    def forward(self, features: Tensor) -> Reading:
        probabilities = self.logits(self._joined(features)).softmax(dim=-1)
        mean = probabilities @ self.tasks
        var = (probabilities.unsqueeze(-1) * (self.tasks - mean.unsqueeze(-2)).square()).sum(dim=-2)
        return Reading(mean, var.sqrt(), probabilities)

    def loss(self, features: Tensor, tasks: Tensor, counts: Tensor, is_spared: Tensor) -> Tensor:
        if self.training:
            self.standardize.update(features)
        place = self._place(tasks).unsqueeze(-1).expand(counts.shape)
        nats = Categorical(logits=self.logits(self._joined(features))).log_prob(place)
        loss: Tensor = -(counts * nats).sum() / counts.sum().clamp(min=1)
        return loss

    def error(self, reading: Reading, tasks: Tensor) -> Tensor:
        """Return 1 minus the probability of the true task."""
        assert reading.probabilities is not None  # for mypy: it is this read-out's
        is_true = F.one_hot(self._place(tasks), len(self.tasks))
        error: Tensor = 1 - (reading.probabilities * is_true).sum(dim=-1)
        return error

    def _place(self, tasks: Tensor) -> Tensor:
        """Return which of the list each task (..., task_dim) is, or is nearest to, (...)."""
        return (tasks.unsqueeze(-2) - self.tasks).square().sum(dim=-1).argmin(dim=-1)


def make_readout(encoder: TaskEncoder, task_dim: int, tasks: Sequence[Sequence[float]] | None) -> TaskReadout:
    """Make the read-out for an encoder, with random numbers that no one else misses.

    Args:
        encoder: whose memory is read.
        task_dim: size of the task vector.
        tasks: all tasks that there are, where these are few; else None.
    """
    with th.random.fork_rng(devices=()), th.no_grad():
        feature_dim = TaskReadout.features(encoder, encoder.empty()).shape[-1]
        if tasks is None:
            return DensityReadout(feature_dim, task_dim)
        return ListReadout(feature_dim, th.tensor(tasks, dtype=th.float32).reshape(-1, task_dim))
