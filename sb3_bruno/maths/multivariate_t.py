"""The multivariate Student-t distribution, by its covariance."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import torch as th
from torch import Tensor
from torch.distributions import Chi2, Distribution, constraints


def student_t_log_density(
    df: Tensor, q: Tensor, n_values: Tensor | int, distance: Tensor, log_volume: Tensor
) -> Tensor:
    """Return the log-density of the multivariate t of k values, with s ~ InvGamma(df / 2, q / 2) and covariance s K.

        lgamma((df + k) / 2) - lgamma(df / 2) - k/2 ln(pi q) - 1/2 ln |K| - (df + k)/2 log1p(distance / q)

    The difference of the two lgamma is computed in float64: each grows to 10^4 and more, their difference does not.

    Args:
        df: degrees of freedom, ``(..., n_scales)``.
        q: twice the scale of the inverse gamma distribution, ``(..., n_scales)``.
        n_values: k.
        distance: x^T K^-1 x, ``(..., n_scales)``.
        log_volume: ln |K|, ``(..., n_scales)``.
    """
    half, more = (df / 2).double(), ((df + n_values) / 2).double()
    log_gammas = (more.lgamma() - half.lgamma()).to(distance.dtype)
    log_normal = 0.5 * (n_values * (math.pi * q).log() + log_volume)
    return log_gammas - log_normal - 0.5 * (df + n_values) * (distance / q).log1p()


class MultivariateStudentT(Distribution):
    r"""Creates a multivariate Student-t distribution with more than two degrees of freedom.

    .. math:: s \sim \text{InvGamma}(\nu / 2, (\nu - 2) / 2), \quad x \mid s \sim N(\mu, s F F^T)

    :math:`F F^T` is the covariance itself, and not a shape matrix. :math:`\nu - 2` is given instead of :math:`\nu`, so
    that the digits of a very small one are kept.

    Args:
        excess_df: nu - 2 > 0, ``(...)``.
        mean: mu, ``(..., k)``.
        cov_tril: F, lower triangular, ``(..., k, k)``.
    """

    arg_constraints: ClassVar[dict[str, constraints.Constraint]] = {}
    support = constraints.real_vector
    has_rsample = True

    def __init__(self, excess_df: Tensor, mean: Tensor, cov_tril: Tensor) -> None:
        batch_shape = th.broadcast_shapes(excess_df.shape, mean.shape[:-1], cov_tril.shape[:-2])
        self.excess_df = excess_df.expand(batch_shape)
        self.loc = mean.expand(*batch_shape, -1)
        self.cov_tril = cov_tril.expand(*batch_shape, -1, -1)
        super().__init__(batch_shape, mean.shape[-1:], validate_args=False)

    def expand(self, batch_shape: Any, _instance: Any = None) -> MultivariateStudentT:
        shape = th.Size(batch_shape)
        return MultivariateStudentT(
            self.excess_df.expand(shape), self.loc.expand(*shape, -1), self.cov_tril.expand(*shape, -1, -1)
        )

    @property
    def df(self) -> Tensor:
        """nu, ``(...)``."""
        return 2 + self.excess_df

    @property
    def mean(self) -> Tensor:
        return self.loc

    @property
    def variance(self) -> Tensor:
        return self.cov_tril.square().sum(dim=-1).expand_as(self.loc)

    @property
    def covariance_matrix(self) -> Tensor:
        """F F^T, ``(..., k, k)``."""
        return self.cov_tril @ self.cov_tril.mT

    def log_prob(self, value: Tensor) -> Tensor:
        error = (value - self.loc).unsqueeze(-1)
        whitened = th.linalg.solve_triangular(self.cov_tril, error, upper=False).squeeze(-1)
        log_volume = 2 * self.cov_tril.diagonal(dim1=-2, dim2=-1).log().sum(dim=-1)
        n_values = self.loc.shape[-1]
        return student_t_log_density(self.df, self.excess_df, n_values, whitened.square().sum(dim=-1), log_volume)

    def rsample(self, sample_shape: Any = ()) -> Tensor:
        shape = self._extended_shape(sample_shape)
        normal = self.loc.new_empty(shape).normal_().unsqueeze(-1)
        scale = self.excess_df / Chi2(self.df, validate_args=False).rsample(sample_shape)
        return self.loc + scale.sqrt().unsqueeze(-1) * (self.cov_tril @ normal).squeeze(-1)
