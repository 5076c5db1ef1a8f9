"""An exchangeable Gaussian process in closed form, over whole batches at once.

It knows torch and nothing else: no flow, no transition, no task.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch as th
from torch import Tensor, nn
from torch.distributions import Distribution, Normal
from torch.nn import functional as F


class Statistics(NamedTuple):
    """What a set of latents leaves behind: n, S1 and W = S2 - S1^2 / n.

    The scatter W stands for the sum of squares S2, which it gives back: of many latents with a mean far from 0, W
    is what float32 would lose in the difference of two large sums.

    :ivar n: the number of latents, shape (..., 1)
    :ivar total: S1, the sum of (z - m), shape (..., dim)
    :ivar scatter: W, the sum of squared deviations from the set's own mean, shape (..., dim)
    """

    n: Tensor
    total: Tensor
    scatter: Tensor

    def merge(self, other: Statistics) -> Statistics:
        """The statistics of both sets together, in whatever order they came.

        W = W' + W'' + n' n'' / (n' + n'') (S1' / n' - S1'' / n'')^2 (Chan, Golub and LeVeque, 1983).
        """
        n, total = self.n + other.n, self.total + other.total
        gap = other.n * self.total - self.n * other.total  # n' n'' times the gap of the means: 0 if a set is empty
        between = gap.square() / (self.n * other.n * n).clamp(min=1)
        return Statistics(n, total, self.scatter + other.scatter + between)


class Distance(NamedTuple):
    """How far a set of latents lies from what the process expects.

    Under the model (beta / k) nu / (nu - 2) is distributed as F(k, nu), and where nu is infinite beta as chi-squared_k.

    :ivar beta: squared Mahalanobis distance, summed over the dimensions that share a scale, shape (..., n_scales)
    :ivar n_values: k, the number of values in it, shape (..., 1)
    :ivar df: nu, degrees of freedom, shape (n_scales,)
    """

    beta: Tensor
    n_values: Tensor
    df: Tensor


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

    def absorb(self, statistics: Statistics, z: Tensor) -> Statistics:
        """The statistics after one more latent each. z: (..., dim)"""
        n, total, scatter = statistics
        return Statistics(n + 1, total + z, scatter + self._added_scatter(n, total, z))

    def statistics(self, z: Tensor) -> Statistics:
        """The statistics of a set of latents. z: (..., time, dim) -> (..., dim)"""
        n, total = th.ones_like(z[..., :1]).sum(dim=-2), z.sum(dim=-2)
        mean = total / n.clamp(min=1)
        return Statistics(n, total, (z - mean.unsqueeze(-2)).square().sum(dim=-2))

    def prefixes(self, z: Tensor, weights: Tensor | None = None) -> Statistics:
        """The statistics of the first 0, 1, ..., time latents, by cumulative sums.

        z: (..., time, dim) -> (..., time + 1, dim); entry t has seen z[..., :t, :] and nothing of z[..., t:, :].
        Of weights (..., time), 1 lets a latent count and 0 leaves it out; None: all count.
        """
        counted = th.ones_like(z[..., :1]) if weights is None else weights.unsqueeze(-1).to(z)
        n, total = (F.pad(one.cumsum(dim=-2), (0, 0, 1, 0)) for one in (counted, counted * z))
        added = counted * self._added_scatter(n[..., :-1, :], total[..., :-1, :], z)
        return Statistics(n, total, F.pad(added.cumsum(dim=-2), (0, 0, 1, 0)))

    @staticmethod
    def _added_scatter(n: Tensor, total: Tensor, z: Tensor) -> Tensor:
        """What one more latent adds to W: (n z - S1)^2 / (n (n + 1)), which is ``Statistics.merge`` of one."""
        return (n * z - total).square() / (n * (n + 1)).clamp(min=1)

    def theta_moments(self, statistics: Statistics) -> tuple[Tensor, Tensor]:
        """mu_n and var_n of theta given z_1..z_n, under the Gaussian process. Shape (..., dim) each."""
        mean, var = theta_moments(statistics, self.cov, self.noise_var)
        return mean, var.expand_as(mean)

    def posterior_moments(self, statistics: Statistics) -> tuple[Tensor, Tensor]:
        """Mean and variance of theta | z_1..z_n, without the rest of the distribution. Shape (..., dim) each."""
        return self.theta_moments(statistics)

    def posterior(self, statistics: Statistics) -> Distribution:
        """p(theta | z_1..z_n) = N(mu_n, var_n). Batch (..., dim)."""
        mean, var = self.theta_moments(statistics)
        return Normal(mean, var.sqrt(), validate_args=False)

    def predictive(self, statistics: Statistics) -> Distribution:
        """p(z_{n+1} | z_1..z_n) = N(mu_n, v - rho + var_n), of each dimension. Batch (..., dim)."""
        mean, var = self.theta_moments(statistics)
        return Normal(mean, (self.noise_var + var).sqrt(), validate_args=False)

    def log_predictive(self, statistics: Statistics, z: Tensor) -> Tensor:
        """log p(z | z_1..z_n) over all dimensions together. z: (..., dim) -> (...)"""
        log_prob: Tensor = self.predictive(statistics).log_prob(z)
        return log_prob.sum(dim=-1)

    def sample(self, statistics: Statistics, n_samples: int) -> Tensor:
        """Draws from the predictive, shape (n_samples, ..., dim)."""
        return self.predictive(statistics).sample(th.Size([n_samples]))

    def squared_mahalanobis(self, statistics: Statistics) -> Tensor:
        """beta_n, which is chi-squared_n under the model. Shape (..., dim)."""
        cov, noise_var = self.cov, self.noise_var
        mean, _ = theta_moments(statistics, cov, noise_var)
        return squared_mahalanobis(statistics, mean, cov, noise_var)

    def distance(self, statistics: Statistics) -> Distance:
        """beta_n of each dimension, with what it should be distributed as."""
        beta = self.squared_mahalanobis(statistics)
        return Distance(beta, statistics.n, th.full_like(self.var, th.inf))

    def log_volume(self, statistics: Statistics) -> Tensor:
        """The log-determinant of the covariance of n latents, (n - 1) ln(v - rho) + ln D_n. Shape (..., dim)."""
        n = statistics.n
        return (n - 1) * self.noise_var.log() + (self.noise_var + n * self.cov).log()

    def log_evidence(self, statistics: Statistics) -> Tensor:
        """log p(z_1..z_n), jointly over the set and all dimensions, shape (...).

        -1/2 [n ln 2 pi + (n - 1) ln(v - rho) + ln D_n + beta_n], summed over the dimensions
        """
        log_normal = statistics.n * math.log(2 * math.pi) + self.log_volume(statistics)
        return -0.5 * (log_normal + self.squared_mahalanobis(statistics)).sum(dim=-1)


def theta_moments(statistics: Statistics, cov: Tensor, noise_var: Tensor) -> tuple[Tensor, Tensor]:
    """mu_n = rho S1 / D_n and var_n = rho (v - rho) / D_n, with D_n = v + (n - 1) rho.

    D_n is summed as (v - rho) + n rho, so that it stays positive at n = 0. Shapes (..., dim), and that of n and rho.
    """
    gain = cov / (noise_var + statistics.n * cov)  # rho / D_n
    return gain * statistics.total, gain * noise_var


def squared_mahalanobis(statistics: Statistics, mean: Tensor, cov: Tensor, noise_var: Tensor) -> Tensor:
    """beta_n = (S2 - rho S1^2 / D_n) / (v - rho), given mu_n. Shape (..., dim).

    Written as W / (v - rho) + S1 mu_n / (n rho), both terms positive: the difference cancels in float32.
    """
    n, total, scatter = statistics
    return scatter / noise_var + total * mean / (n.clamp(min=1) * cov)
