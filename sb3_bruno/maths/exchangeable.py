"""An exchangeable Gaussian process in closed form, for whole batches at once.

Knows torch alone: no flow, no transition, no task.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch as th
from torch import Tensor, nn
from torch.distributions import Distribution, Normal
from torch.nn import functional as F


class Statistics(NamedTuple):
    """The sufficient statistics of a set of latents: n, S1 and W = S2 - S1^2 / n.

    W is kept instead of the sum of squares S2 = W + S1^2 / n. For many latents with a mean far from 0, float32 would
    lose W in the difference of two large sums.

    Attributes:
        n: the number of latents, ``(..., 1)``.
        total: S1, the sum of (z - m), ``(..., dim)``.
        scatter: W, the sum of squared deviations from the set's own mean, ``(..., dim)``.
    """

    n: Tensor
    total: Tensor
    scatter: Tensor

    def merge(self, other: Statistics) -> Statistics:
        """Return the statistics of both sets together; the order of the sets does not matter.

        W = W' + W'' + n' n'' / (n' + n'') (S1' / n' - S1'' / n'')^2 (Chan, Golub and LeVeque, 1983).
        """
        n, total = self.n + other.n, self.total + other.total
        gap = other.n * self.total - self.n * other.total  # n' n'' (mean' - mean''): 0 if a set is empty
        between = gap.square() / (self.n * other.n * n).clamp(min=1)
        return Statistics(n, total, self.scatter + other.scatter + between)


class Distance(NamedTuple):
    """How far a set of latents lies from what the process expects.

    If the model is true, (beta / k) nu / (nu - 2) has the distribution F(k, nu). If nu is infinite, beta has the
    distribution chi-squared_k.

    Attributes:
        beta: squared Mahalanobis distance, summed over the dimensions that share a scale, ``(..., n_scales)``.
        n_values: k, the number of values in that sum, ``(..., 1)``.
        df: nu, the degrees of freedom, ``(n_scales,)``.
    """

    beta: Tensor
    n_values: Tensor
    df: Tensor


class ExchangeableGaussian(nn.Module):
    r"""Creates independent exchangeable Gaussian processes, one per latent dimension.

    .. math:: \theta \sim N(m, \rho), \quad z_i \mid \theta \sim N(\theta, v - \rho), \quad 0 < \rho < v

    Every :math:`z_i` has variance :math:`v`, and every two have covariance :math:`\rho`. The mean is fixed at
    :math:`m = 0`, as in the paper. The variance :math:`v` and the correlation :math:`\rho / v` are learned.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020), section 2.1. Its Eq. 3 is
    corrected here: see the list of deviations in ``docs/method.md``.

    Args:
        dim: number of latent dimensions.
        var: initial variance v of each latent.
        correlation: initial correlation rho / v between two latents of one set.

    Raises:
        ValueError: if ``dim`` or ``var`` is not positive, or ``correlation`` is not inside (0, 1).

    Example:
        >>> process = ExchangeableGaussian(5)
        >>> process.posterior(process.statistics(th.randn(100, 5))).mean.shape
        torch.Size([5])
    """

    def __init__(self, dim: int, *, var: float = 1.0, correlation: float = 0.1) -> None:
        super().__init__()
        if dim < 1:
            raise ValueError(f"dim={dim} is not positive: give the number of latent dimensions, at least 1.")
        if not var > 0:
            raise ValueError(f"var={var} is not positive: give the variance of a latent, such as 1.")
        if not 0 < correlation < 1:
            raise ValueError(f"correlation={correlation} is not between 0 and 1: give one inside, such as 0.1.")
        self.dim = dim
        self.log_var = nn.Parameter(th.full((dim,), math.log(var)))
        self.correlation_logit = nn.Parameter(th.full((dim,), math.log(correlation / (1 - correlation))))

    @property
    def var(self) -> Tensor:
        """v, the variance of each latent, ``(dim,)``."""
        return self.log_var.exp()

    @property
    def cov(self) -> Tensor:
        """rho, the covariance of two latents and the prior variance of theta, ``(dim,)``."""
        return self.var * self.correlation_logit.sigmoid()

    @property
    def noise_var(self) -> Tensor:
        """v - rho, the variance of a latent given theta, ``(dim,)``."""
        return self.var * (-self.correlation_logit).sigmoid()

    def empty(self, batch_shape: tuple[int, ...] = ()) -> Statistics:
        """Return the statistics of no latents, which stand for the prior: ``(*batch_shape, dim)``."""
        zeros = self.log_var.new_zeros(*batch_shape, self.dim)
        return Statistics(zeros[..., :1], zeros, zeros)

    def count(self, statistics: Statistics) -> Tensor:
        """Return the number of latents, ``(..., 1)``."""
        return statistics.n

    def absorb(self, statistics: Statistics, z: Tensor) -> Statistics:
        """Return the statistics after one more latent each, ``z`` of shape ``(..., dim)``."""
        n, total, scatter = statistics
        return Statistics(n + 1, total + z, scatter + self._added_scatter(n, total, z))

    def statistics(self, z: Tensor, weights: Tensor | None = None) -> Statistics:
        """Return the statistics, ``(..., dim)``, of a set of latents ``z``, ``(..., time, dim)``.

        A weight, ``(..., time)``, counts a latent by 1 and leaves it out by 0. None counts all.
        """
        counted = _counted(z, weights)
        n, total = counted.sum(dim=-2), (counted * z).sum(dim=-2)
        mean = total / n.clamp(min=1)
        return Statistics(n, total, (counted * (z - mean.unsqueeze(-2)).square()).sum(dim=-2))

    def prefixes(self, z: Tensor, weights: Tensor | None = None) -> Statistics:
        """Return the statistics of the first 0, 1, ..., time latents, computed by cumulative sums.

        Args:
            z: latents, ``(..., time, dim)``.
            weights: ``(..., time)``; k counts a latent k times and 0 leaves it out. None counts all.

        Returns:
            Statistics ``(..., time + 1, dim)``. Entry t depends on ``z[..., :t, :]`` and not on ``z[..., t:, :]``.
        """
        counted = _counted(z, weights)
        n, total = (F.pad(summand.cumsum(dim=-2), (0, 0, 1, 0)) for summand in (counted, counted * z))
        added = self._added_scatter(n[..., :-1, :], total[..., :-1, :], z, counted)
        return Statistics(n, total, F.pad(added.cumsum(dim=-2), (0, 0, 1, 0)))

    @staticmethod
    def _added_scatter(n: Tensor, total: Tensor, z: Tensor, k: Tensor | float = 1.0) -> Tensor:
        """Return what one more latent, k times, adds to W: k (n z - S1)^2 / (n (n + k)), by ``Statistics.merge``."""
        return k * (n * z - total).square() / (n * (n + k)).clamp(min=1e-12)

    def posterior_moments(self, statistics: Statistics) -> tuple[Tensor, Tensor]:
        """Return mu_n and var_n of theta | z_1..z_n, ``(..., dim)`` each, without building the distribution."""
        mean, var = theta_moments(statistics, self.cov, self.noise_var)
        return mean, var.expand_as(mean)

    def posterior(self, statistics: Statistics) -> Distribution:
        """Return p(theta | z_1..z_n) = N(mu_n, var_n), of batch shape ``(..., dim)``."""
        mean, var = self.posterior_moments(statistics)
        return Normal(mean, var.sqrt(), validate_args=False)

    def predictive(self, statistics: Statistics) -> Distribution:
        """Return p(z_{n+1} | z_1..z_n) = N(mu_n, v - rho + var_n) of each dimension, of batch shape ``(..., dim)``."""
        mean, var = self.posterior_moments(statistics)
        return Normal(mean, (self.noise_var + var).sqrt(), validate_args=False)

    def log_predictive(self, statistics: Statistics, z: Tensor) -> Tensor:
        """Return log p(z | z_1..z_n), ``(...)``, jointly over the dimensions of ``z``, ``(..., dim)``."""
        log_prob: Tensor = self.predictive(statistics).log_prob(z)
        return log_prob.sum(dim=-1)

    def one_step_log_predictives(self, z: Tensor, weights: Tensor | None = None) -> Tensor:
        """Score every latent given those before it, ``(..., time)``; the sum is the joint evidence.

        Args:
            z: latents, ``(..., time, dim)``.
            weights: which latents those after them are given, as in ``prefixes``. All are scored.
        """
        before = Statistics(*(prefixes[..., :-1, :] for prefixes in self.prefixes(z, weights)))
        return self.log_predictive(before, z)

    def log_bayes_factor(self, statistics: Statistics, z: Tensor) -> Tensor:
        """Return log p(z | prior) - log p(z | z_1..z_n) in nats, ``(...)``: far above 0 where the task is another."""
        return self.log_predictive(self.empty(tuple(z.shape[:-1])), z) - self.log_predictive(statistics, z)

    def sample(self, statistics: Statistics, n_samples: int) -> Tensor:
        """Draw from the predictive, ``(n_samples, ..., dim)``."""
        return self.predictive(statistics).sample(th.Size([n_samples]))

    def squared_mahalanobis(self, statistics: Statistics) -> Tensor:
        """Return beta_n, ``(..., dim)``, whose distribution is chi-squared_n if the model is true."""
        cov, noise_var = self.cov, self.noise_var
        mean, _ = theta_moments(statistics, cov, noise_var)
        return squared_mahalanobis(statistics, mean, cov, noise_var)

    def distance(self, statistics: Statistics) -> Distance:
        """Return beta_n of each dimension, with the distribution that it should have."""
        beta = self.squared_mahalanobis(statistics)
        return Distance(beta, statistics.n, th.full_like(self.var, th.inf))

    def log_volume(self, statistics: Statistics) -> Tensor:
        """Return ln |covariance of n latents| = (n - 1) ln(v - rho) + ln D_n, ``(..., dim)``."""
        n = statistics.n
        return (n - 1) * self.noise_var.log() + (self.noise_var + n * self.cov).log()

    def log_evidence(self, statistics: Statistics) -> Tensor:
        """Return log p(z_1..z_n), ``(...)``, jointly over the set and all dimensions.

        Each dimension adds -1/2 [n ln 2 pi + (n - 1) ln(v - rho) + ln D_n + beta_n].
        """
        log_normal = statistics.n * math.log(2 * math.pi) + self.log_volume(statistics)
        return -0.5 * (log_normal + self.squared_mahalanobis(statistics)).sum(dim=-1)


def _counted(z: Tensor, weights: Tensor | None) -> Tensor:
    """Return the weights as a column, ``(..., time, 1)``."""
    return th.ones_like(z[..., :1]) if weights is None else weights.unsqueeze(-1).to(z)


def theta_moments(statistics: Statistics, cov: Tensor, noise_var: Tensor) -> tuple[Tensor, Tensor]:
    """Return mu_n = rho S1 / D_n and var_n = rho (v - rho) / D_n, with D_n = v + (n - 1) rho.

    D_n is computed as (v - rho) + n rho, so that it stays positive at n = 0.

    Args:
        statistics: of z_1..z_n, ``(..., dim)``.
        cov: rho, ``(dim,)``.
        noise_var: v - rho, ``(dim,)``.

    Returns:
        mu_n, ``(..., dim)``, and var_n, of the shape to which n and rho broadcast.
    """
    gain = cov / (noise_var + statistics.n * cov)  # rho / D_n
    return gain * statistics.total, gain * noise_var


def squared_mahalanobis(statistics: Statistics, mean: Tensor, cov: Tensor, noise_var: Tensor) -> Tensor:
    """Return beta_n = (S2 - rho S1^2 / D_n) / (v - rho), ``(..., dim)``, given mu_n.

    It is computed as W / (v - rho) + S1 mu_n / (n rho), of two positive terms: the difference cancels in float32.
    """
    n, total, scatter = statistics
    return scatter / noise_var + total * mean / (n.clamp(min=1) * cov)
