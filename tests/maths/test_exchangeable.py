"""The closed forms agree with an independent slow truth: dense multivariate normals in float64."""

import math

import numpy as np
import pytest
import torch as th
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, kstest, multivariate_normal, norm

from sb3_bruno.maths.exchangeable import ExchangeableGaussian

correlations = st.floats(1e-3, 0.999)
variances = st.floats(1e-2, 1e2)
lengths = st.integers(0, 12)
seeds = st.integers(0, 2**31)


def process_of(dim: int, var: float, correlation: float) -> ExchangeableGaussian:
    return ExchangeableGaussian(dim, var=var, correlation=correlation).double()


def var_and_cov(process: ExchangeableGaussian) -> tuple[float, float]:
    """v and rho as the process holds them, in one dimension."""
    return process.var[0].item(), process.cov[0].item()


def draw(seed: int, *shape: int) -> th.Tensor:
    return th.as_tensor(np.random.default_rng(seed).normal(size=shape))


def dense_cov(n: int, var: float, cov: float) -> np.ndarray:
    return np.full((n, n), cov) + (var - cov) * np.eye(n)


@given(variances, correlations, lengths, seeds)
def test_posterior_and_predictive_are_conditionals_of_the_dense_gaussian(var, correlation, n, seed):
    process, z = process_of(1, var, correlation), draw(seed, n, 1)
    statistics = process.statistics(z)
    var, rho = var_and_cov(process)
    gain = np.linalg.solve(dense_cov(n, var, rho), np.full(n, rho)) if n else np.zeros(0)
    mean = gain @ z.numpy()[:, 0]
    explained = gain @ np.full(n, rho)
    for distribution, prior_var in (
        (process.posterior(statistics), rho),
        (process.predictive(statistics), var),
    ):
        assert distribution.mean.item() == pytest.approx(mean, rel=1e-8, abs=1e-10)
        assert distribution.variance.item() == pytest.approx(prior_var - explained, rel=1e-8)


@given(variances, correlations, st.integers(1, 12), seeds)
def test_evidence_is_the_dense_density(var, correlation, n, seed):
    process, z = process_of(1, var, correlation), draw(seed, n, 1)
    dense = multivariate_normal(np.zeros(n), dense_cov(n, *var_and_cov(process)))
    evidence = process.log_evidence(process.statistics(z)).item()
    assert evidence == pytest.approx(dense.logpdf(z.numpy()[:, 0]), rel=1e-9, abs=1e-9)


@given(variances, correlations, st.integers(1, 12), seeds)
def test_evidence_is_the_product_of_one_step_predictives(var, correlation, n, seed):
    process, z = process_of(3, var, correlation), draw(seed, n, 3)
    prefixes = process.prefixes(z)
    before = type(prefixes)(*(part[:-1] for part in prefixes))
    one_step = process.log_predictive(before, z).sum(dim=0)
    th.testing.assert_close(process.log_evidence(process.statistics(z)), one_step, rtol=1e-8, atol=1e-8)


@given(variances, correlations, lengths, seeds)
def test_prefixes_obey_the_recursion(var, correlation, n, seed):
    """b_i = rho / (v + i rho); mu += b (z - mu); var *= 1 - b: Eq. 3 with its errors corrected."""
    process, z = process_of(2, var, correlation), draw(seed, n, 2)
    posterior = process.posterior(process.prefixes(z))
    var, rho = var_and_cov(process)
    mean, theta_var = th.zeros(2, dtype=th.float64), rho
    for i in range(n + 1):
        th.testing.assert_close(posterior.mean[i], mean, rtol=1e-8, atol=1e-10)
        th.testing.assert_close(posterior.variance[i], th.full_like(mean, theta_var), rtol=1e-8, atol=1e-12)
        if i < n:
            gain = rho / (var + i * rho)
            mean, theta_var = (1 - gain) * mean + gain * z[i], (1 - gain) * theta_var


def test_posterior_variances_of_the_erratum():
    """With v = 1 and rho = 0.1 the paper's Eq. 3 gives 0.1, -0.711, -1.45. Here are the right numbers."""
    process = process_of(1, 1.0, 0.1)
    variances = process.posterior(process.prefixes(th.zeros(3, 1, dtype=th.float64))).variance[:, 0]
    np.testing.assert_allclose(variances.detach(), [0.1, 0.09, 0.1 * 0.9 / 1.1, 0.075], rtol=1e-6)


@given(st.integers(0, 8), st.integers(0, 8), seeds)
def test_neither_order_nor_grouping_matters(n, m, seed):
    process, z = process_of(2, 1.0, 0.3), draw(seed, n + m, 2)
    together = process.statistics(z)
    shuffled = process.statistics(z[np.random.default_rng(seed).permutation(n + m)])
    merged = process.statistics(z[:n]).merge(process.statistics(z[n:]))
    for other in (shuffled, merged, process.empty().merge(together)):
        for expected, found in zip(together, other, strict=True):
            th.testing.assert_close(expected, found.expand_as(expected))
    for expected, found in zip(together, process.prefixes(z), strict=True):
        th.testing.assert_close(expected, found[-1])


def test_the_scatter_gives_the_sum_of_squares_back():
    process, z = process_of(2, 1.0, 0.3), draw(3, 4, 9, 2)
    n, total, scatter = process.statistics(z)
    th.testing.assert_close(scatter + total.square() / n, z.square().sum(dim=1))


@settings(max_examples=20)
@given(variances, correlations, seeds)
def test_squared_mahalanobis_is_the_dense_one_and_chi_squared_under_the_model(var, correlation, seed):
    process, z = process_of(1, var, correlation), draw(seed, 2_000, 10, 1)
    dense = dense_cov(10, *var_and_cov(process))
    z = z.squeeze(-1) @ th.as_tensor(np.linalg.cholesky(dense)).T  # sets drawn from the process
    beta = process.squared_mahalanobis(process.statistics(z.unsqueeze(-1)))[:, 0].detach().numpy()
    np.testing.assert_allclose(beta, np.einsum("bi,ij,bj->b", z, np.linalg.inv(dense), z), rtol=1e-6)
    assert kstest(beta, chi2(10).cdf).pvalue > 1e-4
    distance = process.distance(process.statistics(z.unsqueeze(-1)))
    np.testing.assert_array_equal(distance.beta[:, 0].detach(), beta)
    assert (distance.n_values == 10).all() and distance.df.tolist() == [math.inf]


def test_a_latent_of_weight_zero_does_not_count():
    process, z = process_of(2, 1.0, 0.3), draw(0, 6, 2)
    weights = th.tensor([1.0, 0.0, 1.0, 1.0, 0.0, 1.0], dtype=th.float64)
    left = process.prefixes(z[weights > 0])
    for found, expected in zip(process.prefixes(z, weights), left, strict=True):
        th.testing.assert_close(found, expected[[0, 1, 1, 2, 3, 3, 4]])


def test_prefixes_never_see_the_future():
    process, z = process_of(2, 1.0, 0.3), draw(0, 4, 6, 2)
    changed = z.clone()
    changed[:, 3:] += 100.0
    for before, after in zip(process.prefixes(z), process.prefixes(changed), strict=True):
        th.testing.assert_close(before[:, :4], after[:, :4])


def test_batches_are_independent():
    process, z = process_of(3, 2.0, 0.2), draw(1, 5, 7, 3)
    batched = process.posterior(process.statistics(z)).mean
    singly = th.stack([process.posterior(process.statistics(latents)).mean for latents in z])
    th.testing.assert_close(batched, singly)


def test_float32_stays_true_over_ten_thousand_observations():
    z = draw(2, 10_000, 4) + 0.7
    exact = ExchangeableGaussian(4).double()
    single = ExchangeableGaussian(4)
    for name in ("posterior", "predictive"):
        truth = getattr(exact, name)(exact.prefixes(z))
        found = getattr(single, name)(single.prefixes(z.float()))
        np.testing.assert_allclose(found.mean.detach(), truth.mean.detach(), atol=1e-4)
        np.testing.assert_allclose(found.variance.detach(), truth.variance.detach(), rtol=1e-4)
    beta, true_beta = (
        process.squared_mahalanobis(process.prefixes(z.to(process.log_var.dtype))) for process in (single, exact)
    )
    np.testing.assert_allclose(beta.detach(), true_beta.detach(), rtol=1e-4)


def test_parameters_keep_the_covariance_below_the_variance_wherever_the_optimiser_goes():
    process = ExchangeableGaussian(2).double()
    with th.no_grad():
        process.log_var.copy_(th.tensor([-20.0, 20.0]))
        process.correlation_logit.copy_(th.tensor([-15.0, 15.0]))
    assert (process.cov > 0).all() and (process.noise_var > 0).all()
    th.testing.assert_close(process.cov + process.noise_var, process.var)


@settings(max_examples=25)
@given(variances, correlations, seeds)
def test_gradients_of_the_evidence(var, correlation, seed):
    process, z = process_of(2, var, correlation), draw(seed, 5, 2)

    def evidence(log_var, logit):
        process.log_var.data, process.correlation_logit.data = log_var.data, logit.data
        return th.func.functional_call(
            process, {"log_var": log_var, "correlation_logit": logit}, (), {}, tie_weights=False
        )

    process.forward = lambda: process.log_evidence(process.statistics(z))  # type: ignore[method-assign]
    parameters = (process.log_var, process.correlation_logit)
    inputs = tuple(parameter.detach().clone().requires_grad_() for parameter in parameters)
    assert th.autograd.gradcheck(evidence, inputs, atol=1e-4, rtol=1e-3)


def test_one_latent_is_scored_under_its_marginal():
    process = process_of(1, 4.0, 0.5)
    evidence = process.log_evidence(process.statistics(th.tensor([[1.5]], dtype=th.float64))).item()
    assert evidence == pytest.approx(norm(0, 2).logpdf(1.5))
    assert math.isclose(process.log_evidence(process.empty()).item(), 0.0, abs_tol=1e-12)


@pytest.mark.parametrize("bad", [{"dim": 0}, {"var": 0.0}, {"correlation": 0.0}, {"correlation": 1.0}])
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        ExchangeableGaussian(**{"dim": 2, **bad})
