"""The process with a kernel and an unknown scale agrees with SciPy's dense multivariate t in float64."""

import math

import numpy as np
import pytest
import torch as th
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import f, invgamma, kstest, multivariate_t

from sb3_bruno.maths.kernel_process import KernelGaussian
from sb3_bruno.maths.kernel_process_t import KernelStudentT
from sb3_bruno.maths.kernel_statistics import Features, KernelStatistics
from sb3_bruno.maths.multivariate_t import MultivariateStudentT
from support.kernels import Dense, Observations, draw_observations

sizes = st.integers(1, 4)
lengths = st.integers(0, 7)
dfs = st.floats(2.1, 100.0)
seeds = st.integers(0, 2**31)
EXACT = {"rtol": 1e-9, "atol": 1e-9}


def process_of(n_weights: int, df: float) -> KernelStudentT:
    process = KernelStudentT(n_weights, df=df).double()
    with th.no_grad():
        process.log_excess_df.fill_(math.log(df - 2))  # which was rounded to float32
    return process.requires_grad_(False)


def at(statistics: KernelStatistics, *index) -> KernelStatistics:
    return KernelStatistics(*(part[index] for part in statistics))


def t_log_density(error: np.ndarray, cov: np.ndarray, df: float) -> float:
    """SciPy takes a shape matrix, which is (nu - 2) / nu times the covariance."""
    return float(multivariate_t(np.zeros(len(error)), cov * (df - 2) / df, df=df).logpdf(error)) if len(error) else 0.0


def dense_evidence(observations: Observations, df: float) -> float:
    dense = Dense.of(observations)
    return t_log_density(dense.error, dense.cov, df)


def scale_and_df(dense: Dense, df: float) -> tuple[float, float]:
    """E[s | z] and the degrees of freedom of what is believed after z."""
    n = len(dense.error)
    return (df - 2 + dense.distance) / (df - 2 + n), df + n


@given(sizes, sizes, lengths, dfs, seeds)
def test_evidence_is_the_dense_density_and_the_product_of_one_step_predictives(k, m, n, df, seed):
    process, seen = process_of(k, df), draw_observations(seed, n, n_weights=k, n_values=m)
    truth = dense_evidence(seen, df)
    assert process.log_evidence(process.statistics(*seen)).item() == pytest.approx(truth, rel=1e-9, abs=1e-9)
    assert process.one_step_log_predictives(*seen).sum().item() == pytest.approx(truth, rel=1e-9, abs=1e-9)


@given(sizes, sizes, lengths, dfs, seeds)
def test_predictive_is_a_ratio_of_dense_densities(k, m, n, df, seed):
    process, observations = process_of(k, df), draw_observations(seed, n + 1, n_weights=k, n_values=m)
    seen, (features, z) = observations.at(slice(n)), observations.at(n)
    truth = dense_evidence(observations, df) - dense_evidence(seen, df)
    statistics, predictive = process.statistics(*seen), process.predictive(process.statistics(*seen), features)
    assert process.log_predictive(statistics, features, z).item() == pytest.approx(truth, rel=1e-9, abs=1e-9)
    assert predictive.log_prob(z).item() == pytest.approx(truth, rel=1e-9, abs=1e-9)
    factor = dense_evidence(observations.at(slice(n, None)), df) - truth
    assert process.log_bayes_factor(statistics, features, z).item() == pytest.approx(factor, rel=1e-9, abs=1e-9)
    dense = Dense.of(seen)
    mean, cov = dense.predictive(Dense.of(observations.at(n)))
    scale, _ = scale_and_df(dense, df)
    mean = mean + features.mean.numpy()
    np.testing.assert_allclose(predictive.mean, mean, **EXACT)
    np.testing.assert_allclose(predictive.covariance_matrix, scale * cov, **EXACT)
    np.testing.assert_allclose(process.predictive_moments(statistics, features)[1], scale * cov.diagonal(), **EXACT)


@given(sizes, sizes, lengths, dfs, seeds)
def test_posterior_is_the_dense_t(k, m, n, df, seed):
    process, seen = process_of(k, df), draw_observations(seed, n, n_weights=k, n_values=m)
    statistics, dense = process.statistics(*seen), Dense.of(seen)
    mean, cov = dense.posterior()
    scale, posterior_df = scale_and_df(dense, df)
    posterior = process.posterior(statistics)
    np.testing.assert_allclose(posterior.mean, mean, **EXACT)
    np.testing.assert_allclose(posterior.covariance_matrix, scale * cov, **EXACT)
    np.testing.assert_allclose(posterior.variance, process.posterior_moments(statistics)[1], **EXACT)
    w = np.random.default_rng(seed).normal(size=k)
    truth = t_log_density(w - mean, scale * cov, posterior_df)
    assert posterior.log_prob(th.as_tensor(w)).item() == pytest.approx(truth, rel=1e-9, abs=1e-9)


def test_many_degrees_of_freedom_are_the_gaussian():
    gaussian, process, seen = (
        KernelGaussian(3).double(),
        process_of(3, 1e8),
        draw_observations(0, 4, 20, n_weights=3, n_values=2),
    )
    statistics = process.prefixes(*seen)
    for found, expected in (
        (process.posterior_moments(statistics)[1], gaussian.posterior_moments(statistics)[1]),
        (process.log_evidence(statistics), gaussian.log_evidence(statistics)),
        (process.one_step_log_predictives(*seen), gaussian.one_step_log_predictives(*seen)),
    ):
        th.testing.assert_close(found, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("m", [1, 2])
def test_distance_follows_the_f_distribution_under_the_model(m):
    """(q / N) nu / (nu - 2) ~ F(N, nu), N = n m."""
    df, n, rng = 6.0, 5, np.random.default_rng(6)
    process, (features, z) = process_of(3, df), draw_observations(6, 2_000, n, n_weights=3, n_values=m)
    scale = th.as_tensor(invgamma(df / 2, scale=(df - 2) / 2).rvs((2_000, 1, 1), random_state=rng))
    z = features.mean + scale.sqrt() * (z - features.mean)  # w and the noise alike
    q, n_values, nu = process.distance(process.statistics(features, z))
    assert (n_values == n * m).all() and nu.item() == pytest.approx(df)
    assert kstest(q[:, 0].numpy() / (n * m) * df / (df - 2), f(n * m, df).cdf).pvalue > 1e-3


def test_samples_have_the_predictives_density():
    th.manual_seed(0)
    process, seen = process_of(4, 5.0), draw_observations(1, 3, n_weights=4, n_values=2)
    statistics, (features, _) = process.statistics(*seen.at(slice(2))), seen.at(2)
    predictive = process.predictive(statistics, features)
    for samples in (process.sample(statistics, features, 40_000), predictive.sample((40_000,))):
        whitened = th.linalg.solve_triangular(predictive.cov_tril, (samples - predictive.mean).T, upper=False)
        standard = whitened * (predictive.df / predictive.excess_df).sqrt()
        assert all(kstest(row.numpy(), "t", args=(predictive.df.item(),)).pvalue > 1e-3 for row in standard)
        assert np.corrcoef(whitened.square().log())[0, 1] > 0.02  # what a common scale leaves behind


def test_the_distribution_can_be_expanded():
    distribution = MultivariateStudentT(th.tensor(3.0), th.zeros(2), th.eye(2)).expand((4, 3))
    assert distribution.batch_shape == (4, 3) and distribution.event_shape == (2,)
    assert distribution.rsample((5,)).shape == (5, 4, 3, 2) and distribution.variance.shape == (4, 3, 2)


HARD = {
    "mixed noise": {"log_noise": (-9.0, 5.0)},
    "little noise": {"log_noise": (-9.0, -9.0)},
    "nearly parallel features": {"log_noise": (-9.0, 5.0), "spread": 1e-3},
}
hard = pytest.mark.parametrize("kind", HARD)


@hard
def test_float32_agrees_with_float64_over_ten_thousand_observations(kind):
    seen = draw_observations(0, 10_000, n_weights=8, **HARD[kind]).to(th.float32)
    single, exact = KernelStudentT(8).requires_grad_(False), process_of(8, 10.0)
    found, truth = (
        (
            *process.posterior_moments(process.prefixes(*seen)),
            process.one_step_log_predictives(*seen),
            process.log_evidence(process.prefixes(*seen)),
        )
        for process in (single, exact)
    )
    std = truth[1].sqrt()
    assert ((found[0] - truth[0]) / std).abs().max() < 1e-2
    assert (found[1].log() - truth[1].log()).abs().max() < 1e-2
    for part, other in zip(found[2:], truth[2:], strict=True):
        assert part.dtype == th.float32
        np.testing.assert_allclose(part, other, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("log_excess_df", [-30.0, -20.0, 15.0])
def test_hardly_more_than_two_degrees_of_freedom_keep_their_digits(log_excess_df):
    """In float32 2 + e^-20 is 2, which has no variance."""
    found = []
    for dtype in (th.float32, th.float64):
        process, seen = KernelStudentT(3).to(dtype), draw_observations(0, 9, n_weights=3)
        with th.no_grad():
            process.log_excess_df.fill_(log_excess_df)
        prefixes = process.prefixes(*seen)
        posterior = process.posterior(prefixes)
        assert posterior.variance.isfinite().all() and (process.distance(prefixes).df > 2).all()
        total = process.one_step_log_predictives(*seen).sum() + process.posterior_moments(prefixes)[1].sum()
        total.backward()
        found.append((total, process.log_excess_df.grad, posterior.log_prob(th.zeros(3, dtype=dtype))[1:].sum()))
    for single, exact in zip(*found, strict=True):
        th.testing.assert_close(single.double(), exact.double(), rtol=1e-4, atol=1e-4)


@settings(max_examples=6)
@given(st.integers(1, 3), st.integers(1, 3), dfs, seeds)
def test_gradients_are_those_of_finite_differences(k, m, df, seed):
    process, (features, z) = process_of(k, df), draw_observations(seed, 3, n_weights=k, n_values=m)

    def results(mean, weights, log_noise_var, log_excess_df):
        return th.func.functional_call(process, {"log_excess_df": log_excess_df}, (mean, weights, log_noise_var))

    def forward(mean, weights, log_noise_var):
        given = Features(mean, weights, log_noise_var.exp())
        prefixes = process.prefixes(given, z)
        return (
            *process.posterior_moments(prefixes),
            process.predictive_moments(at(prefixes, slice(3)), given)[1],
            process.one_step_log_predictives(given, z),
            process.log_evidence(prefixes),
        )

    process.forward = forward  # type: ignore[method-assign]
    inputs = (features.mean, features.weights, features.noise_var.log(), process.log_excess_df)
    inputs = tuple(part.detach().clone().requires_grad_() for part in inputs)
    assert th.autograd.gradcheck(results, inputs, atol=1e-5, rtol=1e-4)


@hard
def test_gradients_in_float32_are_those_in_float64(kind):
    seen = draw_observations(3, 2, 200, n_weights=16, **HARD[kind]).to(th.float32)
    gradients = []
    for dtype in (th.float32, th.float64):
        process, (features, z) = KernelStudentT(16).to(dtype), seen.to(dtype)
        features = Features(*(part.requires_grad_() for part in features))
        score = (
            process.one_step_log_predictives(features, z).sum()
            + process.log_evidence(process.statistics(features, z)).sum()
        )
        gradients.append(th.autograd.grad(score, (*features, process.log_excess_df)))
    for found, truth in zip(*gradients, strict=True):
        assert found.isfinite().all() and (found - truth).norm() <= 1e-3 * truth.norm()


def test_other_degrees_of_freedom_are_refused():
    with pytest.raises(ValueError, match="df"):
        KernelStudentT(2, df=2.0)
    with pytest.raises(ValueError, match="n_weights"):
        KernelStudentT(0)
