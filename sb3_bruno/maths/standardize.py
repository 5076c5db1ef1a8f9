"""Standardisation by running statistics. Knows torch, and nothing of what it standardises."""

from __future__ import annotations

import math

import torch as th
from torch import Tensor, nn
from torch.nn import functional as F

NEAR = 10.0
"""Standard deviations from the mean up to which the map is affine, and to which the statistics take an outlier."""
FARTHEST = math.log(1e9)
"""How far beyond ``NEAR`` an image may lie: farther ones are mapped back as if they lay there."""


class Standardize(nn.Module):
    r"""Creates a map to mean 0 and variance 1, whose statistics follow the data slowly.

    .. math:: u = (x - m) / \sqrt{s}, \quad m \leftarrow m + w (\bar x - m),
        \quad s \leftarrow s + w (\overline{(x - m)^2} - s)

    .. math:: y = u \text{ where } |u| \le 10, \quad \operatorname{sign}(u) (10 + \ln(1 + |u| - 10)) \text{ beyond}

    The k-th update has weight w = 1 / k, or ``momentum`` once that is greater. Nothing is learned by gradient. The map
    is the same in training and in use, because no batch is standardised by its own statistics.

    One value of any size neither moves the statistics nor drowns the others. Of a batch, the hundredth that lies
    farthest from its mean counts for at most 10 standard deviations of the rest, unless the rest does not vary: so
    rare rewards among zeros count in full. And the map is logarithmic beyond 10 standard deviations.

    Args:
        dim: size of the last dimension.
        momentum: the least weight of a new batch.

    Example:
        >>> standardize = Standardize(3)
        >>> standardize.update(5 + 2 * th.randn(1000, 3))
        >>> standardize(th.full((3,), 5.0)).abs().max() < 0.2
        tensor(True)
    """

    mean: Tensor
    var: Tensor
    n_updates: Tensor

    def __init__(self, dim: int, momentum: float = 0.001) -> None:
        super().__init__()
        self.momentum = momentum
        self.register_buffer("mean", th.zeros(dim))
        self.register_buffer("var", th.zeros(dim))
        self.register_buffer("n_updates", th.zeros(()))

    @th.no_grad()
    def update(self, x: Tensor) -> None:
        """Move the statistics towards those of a batch, ``(..., dim)``."""
        batch = x.flatten(end_dim=-2)
        if batch.numel() == 0:
            return
        batch = _pull_outliers(batch)
        self.n_updates += 1
        weight = th.clamp(1 / self.n_updates, min=self.momentum)
        self.mean += weight * (batch.mean(dim=0) - self.mean)
        self.var += weight * ((batch - self.mean).square().mean(dim=0) - self.var)

    @property
    def std(self) -> Tensor:
        """The standard deviation, ``(dim,)``; 1 where the data have not varied by more than their mean's rounding."""
        return th.where(self.var > (1e-6 * self.mean).square(), self.var, 1.0).sqrt()

    def forward(self, x: Tensor) -> Tensor:
        """Map x to y, ``(..., dim)`` each."""
        u = (x - self.mean) / self.std
        return u.clamp(-NEAR, NEAR) + u.sign() * F.relu(u.abs() - NEAR).log1p()

    def inverse(self, y: Tensor) -> Tensor:
        """Map y back to x, ``(..., dim)`` each."""
        u = y.clamp(-NEAR, NEAR) + y.sign() * (y.abs() - NEAR).clamp(0.0, FARTHEST).expm1()
        return u * self.std + self.mean

    def log_det(self, y: Tensor) -> Tensor:
        """Return the log-determinant of the map where it led to y, ``(..., dim)`` to ``(...)``."""
        return -(self.std.log() + F.relu(y.abs() - NEAR)).sum(dim=-1)


def _pull_outliers(batch: Tensor) -> Tensor:
    """Bring the hundredth of each column, at least one value, that is farthest from its mean, nearer: ``(n, dim)``."""
    n_suspects = max(len(batch) // 100, 1)
    if n_suspects + 1 > len(batch):
        return batch
    distance = (batch - batch.mean(dim=0)).abs()
    is_near = distance <= distance.topk(n_suspects + 1, dim=0).values[-1]
    n_near = is_near.sum(dim=0)
    middle = th.where(is_near, batch, 0.0).sum(dim=0) / n_near
    var = th.where(is_near, batch - middle, 0.0).square().sum(dim=0) / n_near
    reach = th.where(var > (1e-6 * middle).square(), NEAR * var.sqrt(), th.inf)
    return th.minimum(th.maximum(batch, middle - reach), middle + reach)
