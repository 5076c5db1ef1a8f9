"""An exchangeable Student-t process: the Gaussian process with an unknown scale, inferred from the data.

The variance of the posterior depends on the data, and not only on how many there are.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import torch as th
from torch import Tensor, nn
from torch.distributions import Chi2, Distribution, Gamma, StudentT

from sb3_bruno.maths.exchangeable import (
    Distance,
    ExchangeableGaussian,
    Statistics,
    squared_mahalanobis,
    theta_moments,
)
from sb3_bruno.maths.multivariate_t import student_t_log_density


class StudentTWithVariance(StudentT):
    """A Student-t distribution with more than two degrees of freedom, which never makes a GPU wait.

    Torch's StudentT waits twice: its moments look for entries with two degrees of freedom or fewer, and its
    constructor sends the GPU a constant that only sampling needs.
    """

    def __init__(self, df: Tensor, loc: Tensor, scale: Tensor) -> None:
        self.df, self.loc, self.scale = th.broadcast_tensors(df, loc, scale)
        Distribution.__init__(self, self.df.shape, validate_args=False)

    @cached_property
    def _chi2(self) -> Chi2:  # type: ignore[override]  # torch has an attribute
        return Chi2(self.df)

    def expand(self, batch_shape: Any, _instance: Any = None) -> StudentTWithVariance:
        return StudentTWithVariance(*(parameter.expand(batch_shape) for parameter in (self.df, self.loc, self.scale)))

    @property
    def mean(self) -> Tensor:
        return self.loc

    @property
    def variance(self) -> Tensor:
        return self.scale.pow(2) * self.df / (self.df - 2)


class _Moments(NamedTuple):
    """What z_1..z_n say about theta, about the next latent and about the scale s.

    Attributes:
        mean: mu_n, ``(..., dim)``.
        theta_var: var_n, the variance of theta if s = 1, of the shape to which n and rho broadcast.
        predictive_var: v - rho + var_n, the variance of the next latent if s = 1, of the same shape.
        df: nu_n, of the shape to which n and nu broadcast.
        q: q_n, ``(..., n_scales)``.
    """

    mean: Tensor
    theta_var: Tensor
    predictive_var: Tensor
    df: Tensor
    q: Tensor


class ExchangeableStudentT(ExchangeableGaussian):
    r"""Creates exchangeable Student-t processes with one scale s per latent dimension, or one for all.

    .. math:: s \sim \text{InvGamma}(\nu / 2, (\nu - 2) / 2), \quad \theta \mid s \sim N(0, s \rho),
        \quad z_i \mid \theta, s \sim N(\theta, s (v - \rho))

    The prior mean of s is 1, so :math:`v` and :math:`\rho` are the variance and the covariance of the latents, as in
    the Gaussian process, which is the limit :math:`\nu \to \infty`. All three are learned; :math:`\nu > 2`.

    Reference: Shah, Wilson and Ghahramani, Student-t Processes as Alternatives to Gaussian Processes (2014). Korshunova
    et al. (2020), section 2.1, name it as a remedy for variances that depend on n alone.

    Args:
        dim: number of latent dimensions.
        var: initial variance v of each latent.
        correlation: initial correlation rho / v between two latents of one set.
        df: initial degrees of freedom nu.
        shared_scale: whether all dimensions share one scale s.

    Raises:
        ValueError: if ``df`` is not greater than 2, or as ``ExchangeableGaussian``.
    """

    def __init__(
        self,
        dim: int,
        *,
        var: float = 1.0,
        correlation: float = 0.1,
        df: float = 10.0,
        shared_scale: bool = False,
    ) -> None:
        super().__init__(dim, var=var, correlation=correlation)
        if not df > 2:
            raise ValueError(f"df={df} is not greater than 2, so there is no variance: give more, such as 10.")
        self.shared_scale = shared_scale
        n_scales = 1 if shared_scale else dim
        self.log_excess_df = nn.Parameter(th.full((n_scales,), math.log(df - 2)))

    @property
    def df(self) -> Tensor:
        """nu, the degrees of freedom, ``(n_scales,)``: one per dimension, or a single one for a shared scale."""
        return 2 + self.log_excess_df.exp()

    @property
    def _dims_per_scale(self) -> int:
        return self.dim if self.shared_scale else 1

    def _sum(self, per_dim: Tensor) -> Tensor:
        """Sum over the dimensions that share a scale: ``(..., dim)`` to ``(..., n_scales)``."""
        return per_dim.sum(dim=-1, keepdim=True) if self.shared_scale else per_dim

    def _moments(self, statistics: Statistics) -> _Moments:
        """Return the moments given z_1..z_n.

        The scale is s | z ~ InvGamma(nu_n / 2, q_n / 2), with nu_n = nu + n D and q_n = nu - 2 + beta_n. D dimensions
        share a scale, and beta_n is the sum over them.
        """
        cov, noise_var, df = self.cov, self.noise_var, self.df
        mean, var = theta_moments(statistics, cov, noise_var)
        beta = self._sum(squared_mahalanobis(statistics, mean, cov, noise_var))
        return _Moments(mean, var, noise_var + var, df + self._dims_per_scale * statistics.n, df - 2 + beta)

    def posterior_moments(self, statistics: Statistics) -> tuple[Tensor, Tensor]:
        """Return mu_n and r_n var_n, with r_n = E[s | z] = q_n / (nu_n - 2), ``(..., dim)`` each."""
        mean, var, _, df, q = self._moments(statistics)
        return mean, q / (df - 2) * var

    def posterior(self, statistics: Statistics) -> Distribution:
        """Return p(theta | z_1..z_n) of each dimension: mean mu_n, variance r_n var_n; batch shape ``(..., dim)``."""
        mean, var, _, df, q = self._moments(statistics)
        return StudentTWithVariance(df, mean, (q / df * var).sqrt())

    def predictive(self, statistics: Statistics) -> Distribution:
        """Return p(z_{n+1} | z_1..z_n) of each dimension: mean mu_n, variance r_n (v - rho + var_n).

        The batch shape is ``(..., dim)``.
        """
        mean, _, var, df, q = self._moments(statistics)
        return StudentTWithVariance(df, mean, (q / df * var).sqrt())

    def log_predictive(self, statistics: Statistics, z: Tensor) -> Tensor:
        mean, _, var, df, q = self._moments(statistics)
        distance = self._sum((z - mean).square() / var)
        return student_t_log_density(df, q, self._dims_per_scale, distance, self._sum(var.log())).sum(dim=-1)

    def sample(self, statistics: Statistics, n_samples: int) -> Tensor:
        mean, _, var, df, q = self._moments(statistics)
        precision = Gamma(df / 2, q / 2, validate_args=False).sample(th.Size([n_samples]))  # 1 / s
        return mean + (var / precision).sqrt() * th.randn_like(mean.expand(n_samples, *mean.shape))

    def distance(self, statistics: Statistics) -> Distance:
        """Return beta_n of each scale, with the distribution that it should have."""
        beta = self._sum(self.squared_mahalanobis(statistics))
        return Distance(beta, self._dims_per_scale * statistics.n, self.df)

    def log_evidence(self, statistics: Statistics) -> Tensor:
        """Return log p(z_1..z_n), ``(...)``, jointly over the set and all dimensions: a t of n D values per scale."""
        n_values = self._dims_per_scale * statistics.n
        distance = self._sum(self.squared_mahalanobis(statistics))
        log_volume = self._sum(self.log_volume(statistics))
        return student_t_log_density(self.df, self.df - 2, n_values, distance, log_volume).sum(dim=-1)
