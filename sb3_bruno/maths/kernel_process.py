"""A Gaussian process with a kernel of K features, exchangeable given x, in closed form for whole batches at once.

Knows torch alone: the features come from outside, so that any network of x may make them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch as th
from torch import Tensor, nn
from torch.distributions import Distribution, MultivariateNormal

from sb3_bruno.maths.exchangeable import Distance
from sb3_bruno.maths.inverse_factor import inverse_factor, log_det
from sb3_bruno.maths.kernel_statistics import Features, KernelStatistics, prefix_sums, summands


class Belief(NamedTuple):
    """What a set says about the weights w (if the scale is 1) and about the scale, in float64.

    Attributes:
        mean: mu, ``(..., K)``.
        factor: A, lower triangular, with A A^T = Lambda^-1 the covariance, ``(..., K, K)``.
        noise_log_det: sum of ln det S, ``(..., 1)``.
        n_values: N, ``(..., 1)``.
        q: squared Mahalanobis distance of the set from what the prior expects, ``(..., 1)``.
    """

    mean: Tensor
    factor: Tensor
    noise_log_det: Tensor
    n_values: Tensor
    q: Tensor


class KernelGaussian(nn.Module):
    r"""Creates the Gaussian process whose covariance is :math:`\Phi(x) \Phi(x')^T` and, on the diagonal, noise.

    .. math:: w \sim N(0, I_K), \quad z_i \mid w \sim N(b_i + \Phi_i w, \text{diag } S_i)

    Each :math:`z_i` has m values; :math:`b_i, \Phi_i, S_i` are given as its ``Features``. Given a set, w is
    :math:`N(\Lambda^{-1} \eta, \Lambda^{-1})`, with :math:`\Lambda = I + \sum \Phi_i^T S_i^{-1} \Phi_i` and
    :math:`\eta = \sum \Phi_i^T S_i^{-1} (z_i - b_i)`. The sums do not depend on the order: merging sets is adding.
    ``ExchangeableGaussian`` is the case m = K = 1, :math:`\Phi = \sqrt \rho, S = v - \rho`.

    The sums are computed in float64 and kept in two floats. With noise variances down to e^-9 and n = 10,000 the sums
    reach 10^9: in float32 they swallow the prior I, and the factorisation fails. A covariance updated by rank one in
    float32 gets negative variances there, and a square root of :math:`\Lambda` updated by QR in float32 (in float64,
    stored in float32) is wrong by 5 (.07) posterior standard deviations. The sums in pairs are right to 10^-6, and the
    mean, once rounded to float32, to 10^-3.

    References: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), section 2.1; Harrison, Sharma
    and Pavone, Meta-Learning Priors for Efficient Online Bayesian Regression (2018).

    Args:
        n_weights: K, the number of weights that describe the task.

    Raises:
        ValueError: if ``n_weights`` is not positive.

    Example:
        >>> process = KernelGaussian(8)
        >>> features = Features(th.zeros(100, 1), th.randn(100, 1, 8), th.ones(100, 1))
        >>> process.posterior(process.statistics(features, th.randn(100, 1))).mean.shape
        torch.Size([8])
    """

    def __init__(self, n_weights: int) -> None:
        super().__init__()
        if n_weights < 1:
            raise ValueError(f"n_weights={n_weights} is not positive: give the number of task weights, such as 8.")
        self.n_weights = n_weights
        self.register_buffer("_like", th.empty(0), persistent=False)  # it has the dtype and the device of the results

    _like: Tensor

    def empty(self, batch_shape: tuple[int, ...] = ()) -> KernelStatistics:
        """Return the statistics of no observations, which stand for the prior: ``(*batch_shape, size)``."""
        return KernelStatistics(*[self._like.new_zeros(*batch_shape, (self.n_weights + 1) ** 2 + 2)] * 2)

    def count(self, statistics: KernelStatistics) -> Tensor:
        """Return the number of values, ``(..., 1)``."""
        return self._result(statistics.sums[..., -1:])

    def absorb(self, statistics: KernelStatistics, features: Features, z: Tensor) -> KernelStatistics:
        """Return the statistics after one more observation each, ``z`` of shape ``(..., m)``."""
        return self._split(statistics.sums + summands(features, z))

    def statistics(self, features: Features, z: Tensor, weights: Tensor | None = None) -> KernelStatistics:
        """Return the statistics, ``(..., size)``, of a set of observations, ``z`` of shape ``(..., time, m)``.

        A weight, ``(..., time)``, counts an observation by 1, leaves it out by 0, and tempers it between.
        """
        return self._split(summands(features, z, weights).sum(dim=-2))

    def prefixes(self, features: Features, z: Tensor, weights: Tensor | None = None) -> KernelStatistics:
        """Return the statistics of the first 0, 1, ..., time observations, computed by cumulative sums.

        Args:
            features: of each observation, ``(..., time, ...)``.
            z: observations, ``(..., time, m)``.
            weights: ``(..., time)``; 1 counts an observation and 0 leaves it out. None counts all.

        Returns:
            Statistics ``(..., time + 1, size)``. Entry t depends on the first t observations alone.
        """
        return self._split(prefix_sums(features, z, weights))

    def posterior_moments(self, statistics: KernelStatistics) -> tuple[Tensor, Tensor]:
        """Return mean and variances of w | set, ``(..., K)`` each, without building the distribution."""
        mean, factor = self._posterior(self._belief(statistics.sums))
        return self._result(mean), self._result(factor.square().sum(dim=-1))

    def posterior(self, statistics: KernelStatistics) -> Distribution:
        """Return p(w | set), of batch shape ``(...)`` and event shape ``(K,)``."""
        belief = self._belief(statistics.sums)
        return self._distribution(belief, *self._posterior(belief))

    def predictive_moments(self, statistics: KernelStatistics, features: Features) -> tuple[Tensor, Tensor]:
        """Return mean b + Phi mu and variances of a further observation given the set, ``(..., m)`` each."""
        belief, (b, phi, noise_var) = self._belief(statistics.sums), features.double()
        var = (phi @ belief.factor).square().sum(dim=-1) + noise_var
        return self._result(b + _times(phi, belief.mean)), self._result(self._scale(belief) * var)

    def predictive(self, statistics: KernelStatistics, features: Features) -> Distribution:
        """Return p(z | set) at the features of z, of batch shape ``(...)`` and event shape ``(m,)``."""
        belief, (b, phi, noise_var) = self._belief(statistics.sums), features.double()
        spread = phi @ belief.factor / noise_var.sqrt().unsqueeze(-1)
        whitened, _ = th.linalg.cholesky_ex(_one_plus(spread @ spread.mT))
        std = (self._scale(belief) * noise_var).sqrt()
        return self._distribution(belief, b + _times(phi, belief.mean), std.unsqueeze(-1) * whitened)

    def log_predictive(self, statistics: KernelStatistics, features: Features, z: Tensor) -> Tensor:
        """Return log p(z | set), ``(...)``, jointly over the values of ``z``, ``(..., m)``."""
        return self._result(self._log_predictive(statistics.sums, features, z))

    def one_step_log_predictives(self, features: Features, z: Tensor, weights: Tensor | None = None) -> Tensor:
        """Score every observation given those before it, ``(..., time)``; the sum is the joint evidence.

        Args:
            features: of each observation, ``(..., time, ...)``.
            z: observations, ``(..., time, m)``.
            weights: which observations those after them are given, as in ``prefixes``. All are scored.
        """
        return self._result(self._log_predictive(prefix_sums(features, z, weights)[..., :-1, :], features, z))

    def log_bayes_factor(self, statistics: KernelStatistics, features: Features, z: Tensor) -> Tensor:
        """Return log p(z | prior) - log p(z | set) in nats, ``(...)``: far above 0 where the task is another."""
        before, after = (self._log_predictive(known.sums, features, z) for known in (self.empty(), statistics))
        return self._result(before - after)  # rounded once, for both may be large

    def sample(self, statistics: KernelStatistics, features: Features, n_samples: int) -> Tensor:
        """Draw from the predictive, ``(n_samples, ..., m)``."""
        belief, (b, phi, noise_var) = self._belief(statistics.sums), features.double()
        mean = b + _times(phi, belief.mean)
        spread, noise_std = (phi @ belief.factor).expand(*mean.shape, -1), noise_var.sqrt()
        drawn = _times(spread, mean.new_empty(n_samples, *mean.shape[:-1], self.n_weights).normal_())
        drawn = drawn + noise_std * mean.new_empty(n_samples, *mean.shape).normal_()
        return self._result(mean + self._draw_scale(belief, n_samples).sqrt() * drawn)

    def distance(self, statistics: KernelStatistics) -> Distance:
        """Return q with the distribution that it should have."""
        belief = self._belief(statistics.sums)
        return Distance(self._result(belief.q), self._result(belief.n_values), self._like.new_full((1,), th.inf))

    def log_evidence(self, statistics: KernelStatistics) -> Tensor:
        """Return log p(z_1..z_n), ``(...)``: -1/2 [N ln 2 pi + sum ln det S + ln det Lambda + q] for the Gaussian.

        It costs one factorisation a set, ``one_step_log_predictives`` one for each observation.
        """
        belief = self._belief(statistics.sums)
        log_volume, zero = belief.noise_log_det + log_det(belief.factor), th.zeros_like(belief.q)
        return self._result(self._log_density(zero, zero, belief.n_values, belief.q, log_volume).squeeze(-1))

    def log_evidence_under(self, statistics: KernelStatistics, mean: Tensor, var: Tensor) -> Tensor:
        """Return log p(z_1..z_n) if w ~ N(mean, diag var) instead of N(0, I), for several such priors at once.

        Args:
            statistics: ``(..., size)``.
            mean: ``(..., n_priors, K)``.
            var: ``(K,)``, the same for all of them.

        Returns:
            ``(..., n_priors)``, in float64: what tells one prior from another is a small part of it.
        """
        _, factor, noise_log_det, n_values, q = self._belief_under(statistics.sums, mean, var)
        log_volume, zero = noise_log_det + log_det(factor) + var.double().log().sum(), th.zeros_like(n_values)
        return self._log_density(zero, zero, n_values, q, log_volume)

    def spread_under(self, statistics: KernelStatistics, mean: Tensor, var: Tensor) -> Tensor:
        """Expect how far w lies from the mean of such priors, squared, given the set: ``(..., n_priors, K)``, float64.

        That is the E step of what ``var`` should be, in units of the scale, which is 1 for the Gaussian.
        """
        belief = self._belief_under(statistics.sums, mean, var)
        scale = self._scale(belief._replace(q=belief.q.unsqueeze(-1), n_values=belief.n_values.unsqueeze(-1)))
        return (belief.mean - mean).square() / scale + belief.factor.square().sum(dim=-1).unsqueeze(-2)

    def _belief_under(self, sums: Tensor, mean: Tensor, var: Tensor) -> Belief:
        """Return what follows if w ~ N(mean, diag var): its mean is ``(..., n_priors, K)``, q ``(..., n_priors)``."""
        gram, eta, energy = self._sums(sums)
        precision, mean = 1 / var.double(), mean.double()
        factor = inverse_factor(gram + precision.diag_embed())
        whitened = (eta.unsqueeze(-2) + mean * precision) @ factor
        q = energy + (precision * mean.square()).sum(dim=-1) - whitened.square().sum(dim=-1)
        return Belief(whitened @ factor.mT, factor, sums[..., -2:-1], sums[..., -1:], q.clamp(min=0))

    def _sums(self, sums: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return Lambda - I, ``(..., K, K)``, eta, ``(..., K)``, and the sum of |z - b|^2 / S, ``(..., 1)``."""
        k = self.n_weights
        gram = sums[..., :-2].unflatten(-1, (k + 1, k + 1))
        return gram[..., :k, :k], gram[..., :k, k], gram[..., k, k].unsqueeze(-1)

    def _belief(self, sums: Tensor) -> Belief:
        r"""Return what follows from the sums, ``(..., size)``.

        .. math:: q = \sum |z - b|^2_{S^{-1}} - |A^T \eta|^2 \ge |\mu|^2

        The difference has a relative error of at most |Lambda| 10^-16. The prior's diagonal gets as many units in the
        last place of the sums as keep Lambda positive definite whatever the features. Up to sums of 10^11 they are
        less than a hundredth.
        """
        precision, eta, energy = self._sums(sums)
        trace = precision.detach().diagonal(dim1=-2, dim2=-1).sum(dim=-1)
        factor = inverse_factor(_one_plus(precision, 10 * self.n_weights * th.finfo(th.float64).eps * trace))
        whitened = _times(factor.mT, eta)
        mean = _times(factor, whitened)
        q = th.maximum(energy - _squared_norm(whitened), _squared_norm(mean))
        return Belief(mean, factor, sums[..., -2:-1], sums[..., -1:], q)

    def _posterior(self, belief: Belief) -> tuple[Tensor, Tensor]:
        """Return mean and Cholesky factor of the covariance of w | set."""
        return belief.mean, self._scale(belief).sqrt().unsqueeze(-1) * belief.factor

    def _log_predictive(self, sums: Tensor, features: Features, z: Tensor) -> Tensor:
        belief = self._belief(sums)
        distance, log_volume = _innovation(belief, features.double(), z.double())
        return self._log_density(belief.n_values, belief.q, z.shape[-1], distance, log_volume).squeeze(-1)

    def _split(self, sums: Tensor) -> KernelStatistics:
        return KernelStatistics.of(sums, self._like.dtype)

    def _result(self, tensor: Tensor) -> Tensor:
        return tensor.to(self._like.dtype)

    def _scale(self, belief: Belief) -> Tensor:
        """Return what multiplies all covariances, ``(..., 1)``."""
        return th.ones_like(belief.q)

    def _draw_scale(self, belief: Belief, n_samples: int) -> Tensor:
        """Draw what multiplies all covariances, ``(n_samples, ..., 1)``."""
        return self._scale(belief).expand(n_samples, *belief.q.shape)

    def _distribution(self, belief: Belief, mean: Tensor, cov_tril: Tensor) -> Distribution:
        """Return the distribution with this mean and this Cholesky factor of its covariance, of what belongs to w."""
        return MultivariateNormal(self._result(mean), scale_tril=self._result(cov_tril), validate_args=False)

    def _log_density(
        self, n_seen: Tensor, q_seen: Tensor, n_values: Tensor | int, distance: Tensor, log_volume: Tensor
    ) -> Tensor:
        """Return the log-density, ``(..., 1)``, of N values by their distance and log-volume, given a set's N and q."""
        return -0.5 * (n_values * math.log(2 * math.pi) + log_volume + distance)


def _innovation(belief: Belief, features: Features, z: Tensor) -> tuple[Tensor, Tensor]:
    """Measure how far z lies from its predictive, N(b + Phi mu, S + Phi Lambda^-1 Phi^T), all in float64.

    With B = S^-1/2 Phi A, the whitened covariance I_m + B B^T and I_K + B^T B have the same determinant. The smaller
    of the two is factorised, so that many values cost no more than many weights.

    Returns:
        The squared Mahalanobis distance and the log-determinant of the covariance, ``(..., 1)`` each.
    """
    std = features.noise_var.sqrt()
    error = (z - features.mean - _times(features.weights, belief.mean)) / std
    spread = features.weights @ belief.factor / std.unsqueeze(-1)
    if spread.shape[-2] <= spread.shape[-1]:
        root = inverse_factor(_one_plus(spread @ spread.mT))
        distance = _squared_norm(_times(root.mT, error))
    else:
        root = inverse_factor(_one_plus(spread.mT @ spread))
        update = _times(root, _times(root.mT, _times(spread.mT, error)))  # of the weights, whitened
        distance = _squared_norm(error - _times(spread, update)) + _squared_norm(update)
    return distance, log_det(root) + features.noise_var.log().sum(dim=-1, keepdim=True)


def _one_plus(matrix: Tensor, excess: Tensor | None = None) -> Tensor:
    """Add 1 to the diagonal of ``(..., size, size)``, or 1 + excess, ``(...)``."""
    diagonal = th.ones_like(matrix[..., 0]) if excess is None else (1 + excess).unsqueeze(-1).expand_as(matrix[..., 0])
    return matrix + diagonal.diag_embed()


def _times(matrix: Tensor, vector: Tensor) -> Tensor:
    return (matrix @ vector.unsqueeze(-1)).squeeze(-1)


def _squared_norm(vector: Tensor) -> Tensor:
    return vector.square().sum(dim=-1, keepdim=True)
