"""The process with a kernel and an unknown scale, inferred from the data: a Student-t process.

How sure the belief is depends on the data, and not only on where they were taken.
"""

from __future__ import annotations

import math

import torch as th
from torch import Tensor, nn
from torch.distributions import Distribution, Gamma

from sb3_bruno.maths.exchangeable import Distance
from sb3_bruno.maths.kernel_process import Belief, KernelGaussian
from sb3_bruno.maths.kernel_statistics import KernelStatistics
from sb3_bruno.maths.multivariate_t import MultivariateStudentT, student_t_log_density


class KernelStudentT(KernelGaussian):
    r"""Creates a Student-t process with the kernel of ``KernelGaussian``, all covariances times one scale s.

    .. math:: s \sim \text{InvGamma}(\nu / 2, (\nu - 2) / 2), \quad w \mid s \sim N(0, s I_K),
        \quad z_i \mid w, s \sim N(b_i + \Phi_i w, s \, \text{diag } S_i)

    The prior mean of s is 1; after N values at the squared distance q it is :math:`(\nu - 2 + q) / (\nu + N - 2)`. The
    limit :math:`\nu \to \infty` is the Gaussian process. :math:`\nu > 2` is learned, as the logarithm of
    :math:`\nu - 2`, and :math:`\nu - 2` is never computed from :math:`\nu`.

    Reference: Shah, Wilson and Ghahramani, Student-t Processes as Alternatives to Gaussian Processes (2014).

    Args:
        n_weights: K, the number of weights that describe the task.
        df: initial degrees of freedom nu.

    Raises:
        ValueError: if ``df`` is not greater than 2, or as ``KernelGaussian``.
    """

    def __init__(self, n_weights: int, *, df: float = 10.0) -> None:
        super().__init__(n_weights)
        if not df > 2:
            raise ValueError(f"df={df} is not greater than 2, so there is no variance: give more, such as 10.")
        self.log_excess_df = nn.Parameter(th.tensor([math.log(df - 2)]))

    @property
    def excess_df(self) -> Tensor:
        """nu - 2 in float64, ``(1,)``."""
        return self.log_excess_df.double().exp()

    @property
    def df(self) -> Tensor:
        """nu, the degrees of freedom, in float64, ``(1,)``."""
        return 2 + self.excess_df

    def distance(self, statistics: KernelStatistics) -> Distance:
        """Return q with the distribution that it should have; nu in float64, where nu - 2 has digits left."""
        return super().distance(statistics)._replace(df=self.df)

    def _scale(self, belief: Belief) -> Tensor:
        return (self.excess_df + belief.q) / (self.excess_df + belief.n_values)

    def _draw_scale(self, belief: Belief, n_samples: int) -> Tensor:
        shape, rate = (self.df + belief.n_values) / 2, (self.excess_df + belief.q) / 2
        return 1 / Gamma(shape, rate, validate_args=False).sample(th.Size([n_samples]))

    def _distribution(self, belief: Belief, mean: Tensor, cov_tril: Tensor) -> Distribution:
        excess_df = (self.excess_df + belief.n_values).squeeze(-1)
        return MultivariateStudentT(*map(self._result, (excess_df, mean, cov_tril)))

    def _log_density(
        self, n_seen: Tensor, q_seen: Tensor, n_values: Tensor | int, distance: Tensor, log_volume: Tensor
    ) -> Tensor:
        return student_t_log_density(self.df + n_seen, self.excess_df + q_seen, n_values, distance, log_volume)
