"""An exchangeable Gaussian process in closed form, over whole batches at once.

The file knows torch and nothing else: no flow, no transition, no task.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch as th
from torch import Tensor, nn
from torch.distributions import Normal
from torch.nn import functional as F


class Statistics(NamedTuple):
    """What a set of latents leaves behind: (n, S1, S2). Merging two sets is adding.

    :ivar n: the number of latents, shape (..., 1)
    :ivar total: S1, the sum of (z - m), shape (..., dim)
    :ivar total_sq: S2, the sum of (z - m)^2, shape (..., dim)
    """

    n: Tensor
    total: Tensor
    total_sq: Tensor

    def merge(self, other: Statistics) -> Statistics:
        """The statistics of both sets together, in whatever order they came."""
        return Statistics(*(mine + theirs for mine, theirs in zip(self, other, strict=True)))


class ExchangeableGaussian(nn.Module):
    r"""Creates independent exchangeable Gaussian processes, one per latent dimension.

    .. math:: \theta \sim N(m, \rho), \quad z_i \mid \theta \sim N(\theta, v - \rho), \quad 0 < \rho < v

    so that every :math:`z_i` has variance :math:`v` and every pair covariance :math:`\rho`. The mean is fixed
    at :math:`m = 0`, as in the paper; :math:`v` and the correlation :math:`\rho / v` are learned.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020), section 2.1, whose
    Eq. 3 is corrected here: see the list of deviations in ``docs/method.md``.

    :param dim: number of latent dimensions
    :param var: initial variance v of each latent
    :param correlation: initial correlation rho / v between two latents of one set
    :raises ValueError: if ``dim`` or ``var`` is not positive, or ``correlation`` not inside (0, 1)

    Example:
        >>> process = ExchangeableGaussian(5)
        >>> process.posterior(process.statistics(th.randn(100, 5))).mean.shape
        torch.Size([5])
    """

    def __init__(self, dim: int, *, var: float = 1.0, correlation: float = 0.1) -> None:
        super().__init__()
        if dim < 1:
            raise ValueError(f"`dim` must be at least 1, got {dim}: a process needs a latent dimension.")
        if not var > 0:
            raise ValueError(f"`var` must be positive, got {var}.")
        if not 0 < correlation < 1:
            raise ValueError(f"`correlation` must lie strictly between 0 and 1, got {correlation}.")
        self.dim = dim
        self.log_var = nn.Parameter(th.full((dim,), math.log(var)))
        self.correlation_logit = nn.Parameter(th.full((dim,), math.log(correlation / (1 - correlation))))

    @property
    def var(self) -> Tensor:
        """v, the variance of one latent, shape (dim,)."""
        return self.log_var.exp()

    @property
    def cov(self) -> Tensor:
        """rho, the covariance of two latents and the prior variance of theta, shape (dim,)."""
        return self.var * self.correlation_logit.sigmoid()

    @property
    def noise_var(self) -> Tensor:
        """v - rho, the variance of a latent once theta is known, shape (dim,)."""
        return self.var * (-self.correlation_logit).sigmoid()

    def empty(self, batch_shape: tuple[int, ...] = ()) -> Statistics:
        """The statistics of no latents: the prior."""
        zeros = self.log_var.new_zeros(*batch_shape, self.dim)
        return Statistics(zeros[..., :1], zeros, zeros)

    def observe(self, z: Tensor) -> Statistics:
        """The statistics of every latent by itself. z: (..., dim)"""
        return Statistics(th.ones_like(z[..., :1]), z, z.square())

    def statistics(self, z: Tensor) -> Statistics:
        """The statistics of a set of latents. z: (..., time, dim) -> (..., dim)"""
        return Statistics(*(one.sum(dim=-2) for one in self.observe(z)))

    def prefixes(self, z: Tensor) -> Statistics:
        """The statistics of the first 0, 1, ..., time latents, by a cumulative sum.

        z: (..., time, dim) -> (..., time + 1, dim); entry t has seen z[..., :t, :] and nothing of z[..., t:, :].
        """
        return Statistics(*(F.pad(one.cumsum(dim=-2), (0, 0, 1, 0)) for one in self.observe(z)))

    def posterior(self, statistics: Statistics) -> Normal:
        """p(theta | z_1..z_n) = N(rho S1 / D_n, rho (v - rho) / D_n), D_n = v + (n - 1) rho. Batch (..., dim).

        D_n is summed as (v - rho) + n rho, so that it stays positive at n = 0.
        """
        cov, noise_var = self.cov, self.noise_var
        gain = cov / (noise_var + statistics.n * cov)  # rho / D_n
        mean = gain * statistics.total
        return Normal(mean, (gain * noise_var).sqrt().expand_as(mean), validate_args=False)

    def predictive(self, statistics: Statistics) -> Normal:
        """p(z_{n+1} | z_1..z_n) = N(mu_n, v - rho + var_n). Batch (..., dim)."""
        theta = self.posterior(statistics)
        return Normal(theta.mean, (self.noise_var + theta.variance).sqrt(), validate_args=False)

    def log_evidence(self, statistics: Statistics) -> Tensor:
        """log p(z_1..z_n), jointly over the set and per dimension, shape (..., dim).

        -1/2 [n ln 2 pi + (n - 1) ln(v - rho) + ln D_n + (S2 - rho S1^2 / D_n) / (v - rho)]
        """
        n, total, total_sq = statistics
        scale = self.noise_var + n * self.cov  # D_n
        deviance = (total_sq - self.cov * total.square() / scale) / self.noise_var
        log_volume = n * math.log(2 * math.pi) + (n - 1) * self.noise_var.log() + scale.log()
        return -0.5 * (log_volume + deviance)
