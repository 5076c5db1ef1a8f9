"""Standardisation by running statistics. Knows torch, and nothing of what it standardises."""

from __future__ import annotations

import torch as th
from torch import Tensor, nn

FARTHEST = 100.0
"""Standard deviations from the mean at which a value is cut off before the statistics follow it."""


class Standardize(nn.Module):
    r"""Creates an affine map to mean 0 and variance 1, whose statistics follow the data slowly.

    .. math:: y = (x - m) / \sqrt{s}, \quad m \leftarrow m + w (\bar x - m),
        \quad s \leftarrow s + w (\overline{(x - m)^2} - s)

    The k-th update has weight w = 1 / k, or ``momentum`` once that is greater. Nothing is learned by gradient. The map
    is the same in training and in use, because no batch is standardised by its own statistics.

    The statistics take a value farther than 100 standard deviations from the mean for one at that distance: so one
    value of any size moves them by little, and a scale that really changed is still followed, exponentially.

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
        if len(batch) == 0:
            return
        reach = th.where(self._varies, FARTHEST * self.var.sqrt(), th.inf)
        batch = self.mean + (batch - self.mean).clamp(-reach, reach)
        self.n_updates += 1
        weight = th.clamp(1 / self.n_updates, min=self.momentum)
        self.mean += weight * (batch.mean(dim=0) - self.mean)
        self.var += weight * ((batch - self.mean).square().mean(dim=0) - self.var)

    @property
    def _varies(self) -> Tensor:
        """Whether the data vary by more than the rounding of their mean, ``(dim,)``."""
        return self.var > (1e-6 * self.mean).square()

    @property
    def std(self) -> Tensor:
        """The standard deviation, ``(dim,)``; 1 where the data have not varied yet."""
        return th.where(self._varies, self.var, 1.0).sqrt()

    def forward(self, x: Tensor) -> Tensor:
        """Map x to y, ``(..., dim)`` each."""
        return (x - self.mean) / self.std

    def inverse(self, y: Tensor) -> Tensor:
        """Map y back to x, ``(..., dim)`` each."""
        return y * self.std + self.mean
