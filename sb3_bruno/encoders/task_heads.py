"""Turns features into a probability distribution over the task, in the task's own units."""

from __future__ import annotations

from typing import Literal

import torch as th
from torch import Tensor, nn
from torch.distributions import Categorical, Distribution, Independent, MixtureSameFamily, Normal, OneHotCategorical
from torch.nn import functional as F

from sb3_bruno.maths.features import LEAST_NOISE_VAR
from sb3_bruno.maths.standardize import Standardize

TaskHeadName = Literal["gaussian", "mixture", "one_hot"]


class GaussianHead(nn.Module):
    """Creates a Gaussian with learned mean and variance, or a mixture of several.

    Its mean and variance are those of standardised tasks, so entries of different scale weigh alike.

    Args:
        feature_dim: dimension of the features.
        task_dim: size of the task vector.
        n_components: of the mixture; 1 is the Gaussian.
    """

    def __init__(self, feature_dim: int, task_dim: int, n_components: int = 1) -> None:
        super().__init__()
        self.standardize = Standardize(task_dim)
        self.moments_dim = 2 * task_dim
        self.components = nn.Linear(feature_dim, n_components * 2 * task_dim)
        self.logits = nn.Linear(feature_dim, n_components) if n_components > 1 else None
        self._shape = (n_components, 2 * task_dim)

    def check(self, tasks: Tensor) -> None:
        """Take any tasks, (n, task_dim)."""

    def update(self, tasks: Tensor) -> None:
        """Move the running statistics that standardise towards those of tasks, (batch, task_dim)."""
        self.standardize.update(tasks)

    def forward(self, features: Tensor) -> Distribution:
        """Return the distribution over tasks: (..., feature_dim) -> batch shape (...), event shape (task_dim,)"""
        mean, scale = self.components(features).unflatten(-1, self._shape).chunk(2, dim=-1)
        unit = self.standardize.std
        mean, std = self.standardize.mean + unit * mean, unit * (LEAST_NOISE_VAR**0.5 + F.softplus(scale))
        if self.logits is None:
            return Independent(Normal(mean.squeeze(-2), std.squeeze(-2)), 1)
        return mixture_of_gaussians(self.logits(features), mean, std)

    def moments(self, tasks: Distribution) -> Tensor:
        """Return mean and log-variance of the standardised task, shape (..., 2 task_dim)."""
        mean = (tasks.mean - self.standardize.mean) / self.standardize.std
        return th.cat([mean, (tasks.variance / self.standardize.std.square()).log()], dim=-1)


class OneHotHead(nn.Module):
    """Creates a categorical distribution over tasks that are numbered by one-hot vectors.

    Args:
        feature_dim: dimension of the features.
        task_dim: number of tasks.

    Raises:
        ValueError: if there are fewer than two.
    """

    def __init__(self, feature_dim: int, task_dim: int) -> None:
        if task_dim < 2:
            raise ValueError(
                f"`head='one_hot'` needs tasks that are one-hot vectors, got tasks of size {task_dim}: use 'gaussian'."
            )
        super().__init__()
        self.moments_dim = task_dim
        self.logits = nn.Linear(feature_dim, task_dim)

    def update(self, tasks: Tensor) -> None:
        """Check tasks, (batch, task_dim): not all could be checked before.

        Raises:
            ValueError: if one is no one-hot vector.
        """
        self.check(tasks)

    def check(self, tasks: Tensor) -> None:
        """Refuse tasks, (n, task_dim), that are no one-hot vectors.

        Raises:
            ValueError: if one is no one-hot vector.
        """
        is_one_hot = (tasks.sum(dim=-1) == 1) & (tasks.amax(dim=-1) == 1) & (tasks.amin(dim=-1) == 0)
        if not is_one_hot.all():
            wrong = tasks[~is_one_hot][0].tolist()
            raise ValueError(f"`head='one_hot'` needs tasks that are one-hot vectors, got {wrong}: use 'gaussian'.")

    def forward(self, features: Tensor) -> Distribution:
        """Return the distribution over tasks: (..., feature_dim) -> batch shape (...), event shape (task_dim,)"""
        return OneHotCategorical(logits=self.logits(features))

    def moments(self, tasks: Distribution) -> Tensor:
        """Return the tasks' probabilities, shape (..., task_dim)."""
        return tasks.mean


def mixture_of_gaussians(logits: Tensor, means: Tensor, stds: Tensor) -> MixtureSameFamily:
    """Join Gaussians, (..., n_components, task_dim), with the logits (..., n_components) of the choice between them."""
    return MixtureSameFamily(Categorical(logits=logits), Independent(Normal(means, stds), 1))


def make_head(name: TaskHeadName, feature_dim: int, task_dim: int) -> GaussianHead | OneHotHead:
    """Make a head by its name; a mixture has two components."""
    if name == "one_hot":
        return OneHotHead(feature_dim, task_dim)
    return GaussianHead(feature_dim, task_dim, n_components=2 if name == "mixture" else 1)
