"""The closed forms agree with an independent slow truth; float32 does where features and noise are at their worst."""

import math

import numpy as np
import pytest
import torch as th
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, kstest, multivariate_normal

from sb3_bruno.maths.exchangeable import ExchangeableGaussian
from sb3_bruno.maths.inverse_factor import inverse_factor, log_det
from sb3_bruno.maths.kernel_process import KernelGaussian
from sb3_bruno.maths.kernel_statistics import Features, KernelStatistics
from support.kernels import Dense, Observations, draw_observations, least_squares

sizes = st.integers(1, 4)
lengths = st.integers(0, 7)
seeds = st.integers(0, 2**31)
EXACT = {"rtol": 1e-9, "atol": 1e-9}


def process_of(n_weights: int) -> KernelGaussian:
    return KernelGaussian(n_weights).double()


def at(statistics: KernelStatistics, *index) -> KernelStatistics:
    return KernelStatistics(*(part[index] for part in statistics))


def assert_same(found: KernelStatistics, expected: KernelStatistics) -> None:
    th.testing.assert_close(found.sums, expected.sums, **EXACT)


@given(sizes, sizes, lengths, seeds)
def test_posterior_is_the_conditional_of_the_dense_normal(k, m, n, seed):
    process, seen = process_of(k), draw_observations(seed, n, n_weights=k, n_values=m)
    statistics = process.statistics(*seen)
    mean, cov = Dense.of(seen).posterior()
    posterior = process.posterior(statistics)
    np.testing.assert_allclose(posterior.mean, mean, **EXACT)
    np.testing.assert_allclose(posterior.covariance_matrix, cov, **EXACT)
    found_mean, found_var = process.posterior_moments(statistics)
    np.testing.assert_allclose(found_mean, mean, **EXACT)
    np.testing.assert_allclose(found_var, cov.diagonal(), **EXACT)


@given(sizes, sizes, lengths, seeds)
def test_predictive_is_the_conditional_of_the_dense_normal(k, m, n, seed):
    process, observations = process_of(k), draw_observations(seed, n + 1, n_weights=k, n_values=m)
    seen, (features, z) = observations.at(slice(n)), observations.at(n)
    statistics = process.statistics(*seen)
    mean, cov = Dense.of(seen).predictive(Dense.of(observations.at(n)))
    mean = mean + features.mean.numpy()
    predictive = process.predictive(statistics, features)
    np.testing.assert_allclose(predictive.mean, mean, **EXACT)
    np.testing.assert_allclose(predictive.covariance_matrix, cov, **EXACT)
    found_mean, found_var = process.predictive_moments(statistics, features)
    np.testing.assert_allclose(found_mean, mean, **EXACT)
    np.testing.assert_allclose(found_var, cov.diagonal(), **EXACT)
    believed, prior = multivariate_normal(mean, cov), Dense.of(observations.at(n))
    found = process.log_predictive(statistics, features, z).item()
    assert found == pytest.approx(believed.logpdf(z), rel=1e-9, abs=1e-9)
    factor = multivariate_normal(features.mean, prior.cov).logpdf(z) - believed.logpdf(z)
    assert process.log_bayes_factor(statistics, features, z).item() == pytest.approx(factor, rel=1e-9, abs=1e-9)


@given(sizes, sizes, st.integers(1, 7), seeds)
def test_evidence_is_the_dense_density_and_the_product_of_one_step_predictives(k, m, n, seed):
    process, seen = process_of(k), draw_observations(seed, n, n_weights=k, n_values=m)
    dense = Dense.of(seen)
    truth = multivariate_normal(np.zeros(n * m), dense.cov).logpdf(dense.error)
    statistics = process.statistics(*seen)
    assert process.log_evidence(statistics).item() == pytest.approx(truth, rel=1e-9, abs=1e-9)
    assert process.one_step_log_predictives(*seen).sum().item() == pytest.approx(truth, rel=1e-9, abs=1e-9)
    assert process.distance(statistics).beta.item() == pytest.approx(dense.distance, rel=1e-9, abs=1e-9)


@given(st.floats(1e-2, 1e2), st.floats(1e-3, 0.999), lengths, seeds)
def test_the_exchangeable_process_is_a_special_case(var, correlation, n, seed):
    """One value, one weight, Phi = sqrt(rho), S = v - rho: then theta = sqrt(rho) w."""
    exchangeable, process = ExchangeableGaussian(1, var=var, correlation=correlation).double(), process_of(1)
    z = th.as_tensor(np.random.default_rng(seed).normal(size=(3, n, 1)))
    root = exchangeable.cov.sqrt()
    features = Features(th.zeros(1), root.unsqueeze(-1), exchangeable.noise_var)
    expected, found = exchangeable.prefixes(z), process.prefixes(features, z)
    mean, theta_var = exchangeable.posterior_moments(expected)
    w_mean, w_var = process.posterior_moments(found)
    th.testing.assert_close(root * w_mean, mean, **EXACT)
    th.testing.assert_close(root.square() * w_var, theta_var, **EXACT)
    th.testing.assert_close(process.predictive(found, features).variance, exchangeable.predictive(expected).variance)
    th.testing.assert_close(process.log_evidence(found), exchangeable.log_evidence(expected), **EXACT)
    for part, other in zip(process.distance(found), exchangeable.distance(expected), strict=True):
        th.testing.assert_close(part, other.expand_as(part).to(part), **EXACT)


@given(sizes, sizes, lengths, lengths, seeds)
def test_neither_order_nor_grouping_matters(k, m, n, more, seed):
    process, seen = process_of(k), draw_observations(seed, n + more, n_weights=k, n_values=m)
    together = process.statistics(*seen)
    assert_same(process.statistics(*seen.at(np.random.default_rng(seed).permutation(n + more))), together)
    parts = [process.statistics(*seen.at(slice(*ends))) for ends in ((None, n), (n, None))]
    assert_same(parts[0].merge(parts[1]), together)
    assert_same(parts[1].merge(parts[0]), together)
    assert_same(process.empty().merge(together), together)


@given(sizes, sizes, lengths, seeds)
def test_prefixes_are_what_absorbing_one_by_one_gives(k, m, n, seed):
    process, seen = process_of(k), draw_observations(seed, 2, n, n_weights=k, n_values=m)
    prefixes, statistics = process.prefixes(*seen), process.empty((2,))
    for t in range(n + 1):
        assert_same(at(prefixes, slice(None), t), statistics)
        assert_same(process.statistics(*seen.at(slice(None), slice(t))), statistics)
        if t < n:
            statistics = process.absorb(statistics, *seen.at(slice(None), t))


def test_an_observation_of_weight_zero_does_not_count():
    process, seen = process_of(3), draw_observations(0, 6, n_weights=3, n_values=2)
    weights = th.tensor([1.0, 0.0, 1.0, 1.0, 0.0, 1.0])
    left = process.prefixes(*seen.at(weights > 0))
    assert_same(process.prefixes(*seen, weights), at(left, [0, 1, 1, 2, 3, 3, 4]))
    assert_same(process.statistics(*seen, weights), at(left, -1))
    scores = process.one_step_log_predictives(*seen, weights)[weights > 0]
    th.testing.assert_close(scores, process.one_step_log_predictives(*seen.at(weights > 0)), **EXACT)


def test_an_observation_of_half_the_weight_has_twice_the_noise():
    process, (features, z) = process_of(3), draw_observations(0, 6, n_weights=3)
    tempered = process.posterior_moments(process.statistics(features, z, th.full((6,), 0.5)))
    noisy = features._replace(noise_var=2 * features.noise_var)
    for found, expected in zip(tempered, process.posterior_moments(process.statistics(noisy, z)), strict=True):
        th.testing.assert_close(found, expected, **EXACT)


@settings(max_examples=15)
@given(sizes, sizes, seeds)
def test_distance_is_chi_squared_under_the_model(k, m, seed):
    process, seen = process_of(k), draw_observations(seed, 1_000, 6, n_weights=k, n_values=m)
    distance = process.distance(process.statistics(*seen))
    assert (distance.n_values == 6 * m).all() and distance.df.tolist() == [math.inf]
    assert kstest(distance.beta[:, 0].numpy(), chi2(6 * m).cdf).pvalue > 1e-4


@pytest.mark.parametrize("m", [1, 3])
def test_samples_have_the_predictives_moments(m):
    th.manual_seed(0)
    process, seen = process_of(4), draw_observations(1, 3, n_weights=4, n_values=m)
    statistics, (features, _) = process.statistics(*seen.at(slice(2))), seen.at(2)
    samples = process.sample(statistics, features, 40_000).numpy()
    predictive = process.predictive(statistics, features)
    whitened = np.linalg.solve(np.linalg.cholesky(predictive.covariance_matrix), (samples - predictive.mean.numpy()).T)
    assert all(kstest(row, "norm").pvalue > 1e-3 for row in whitened)
    np.testing.assert_allclose(np.cov(whitened), np.eye(m).squeeze(), atol=0.03)
    assert process.sample(process.empty((5, 2)), features, 7).shape == (7, 5, 2, m)


HARD = {  # noise variances as powers of e, and how much the columns of Phi differ
    "mixed noise": {"log_noise": (-9.0, 5.0)},
    "little noise": {"log_noise": (-9.0, -9.0)},
    "much noise": {"log_noise": (5.0, 5.0)},
    "nearly parallel features": {"log_noise": (-9.0, 5.0), "spread": 1e-3},
    "parallel features": {"log_noise": (-9.0, -9.0), "spread": 1e-6},
}
hard = pytest.mark.parametrize("kind", HARD)


def hard_case(kind: str, n: int, n_weights: int) -> Observations:
    return draw_observations(n + n_weights, n, n_weights=n_weights, **HARD[kind]).to(th.float32)


def assert_near(found: tuple[th.Tensor, th.Tensor], mean: np.ndarray, var: np.ndarray) -> None:
    """Means within a hundredth of a posterior standard deviation, variances within a hundredth of their own."""
    assert found[0].dtype == found[1].dtype == th.float32 and (found[1] > 0).all()
    np.testing.assert_allclose((found[0].numpy() - mean) / np.sqrt(var), 0, atol=1e-2)
    np.testing.assert_allclose(np.log(found[1].numpy() / var), 0, atol=1e-2)


@hard
@pytest.mark.parametrize("n_weights", [1, 8, 32])
def test_float32_beside_the_dense_truth_of_300_observations(kind, n_weights):
    process, seen = KernelGaussian(n_weights), hard_case(kind, 300, n_weights)
    features, _ = further = hard_case(kind, 1, n_weights).at(0)
    statistics = process.statistics(*seen)
    assert_near(process.posterior_moments(statistics), *least_squares(seen))
    dense, extra = Dense.of(seen), Dense.of(further)
    mean, cov = dense.predictive(extra)
    assert_near(process.predictive_moments(statistics, features), mean + features.mean.double().numpy(), cov[0])
    truth = -0.5 * (300 * math.log(2 * math.pi) + np.linalg.slogdet(dense.cov)[1] + dense.distance)
    assert process.log_evidence(statistics).item() == pytest.approx(truth, rel=1e-6)
    assert process.one_step_log_predictives(*seen).double().sum().item() == pytest.approx(truth, rel=1e-5)
    assert process.distance(statistics).beta.item() == pytest.approx(dense.distance, rel=1e-5)


@hard
def test_float32_stays_true_over_ten_thousand_observations(kind):
    single, exact, seen = KernelGaussian(32), process_of(32), hard_case(kind, 10_000, 32)
    some = th.arange(0, 10_001, 100)
    found, truth = (at(process.prefixes(*seen), some) for process in (single, exact))
    mean, var = exact.posterior_moments(truth)
    assert_near(single.posterior_moments(found), mean.numpy(), var.numpy())
    assert_near(tuple(part[-1] for part in single.posterior_moments(found)), *least_squares(seen))
    np.testing.assert_allclose(single.log_evidence(found), exact.log_evidence(truth), rtol=1e-5, atol=1e-4)


def test_float32_carried_from_step_to_step_stays_true():
    process, seen = KernelGaussian(8), hard_case("nearly parallel features", 10_000, 8)
    statistics = process.empty()
    for t in range(10_000):
        statistics = process.absorb(statistics, *seen.at(t))
    assert statistics.high.dtype == statistics.low.dtype == th.float32
    assert_near(process.posterior_moments(statistics), *least_squares(seen))


@given(st.integers(1, 32), st.floats(-60.0, 5.0), st.sampled_from([0.0, 1e-12, 1e-6, 1.0]), st.floats(0.0, 8.0), seeds)
def test_no_factorisation_fails_and_no_variance_is_negative(k, log_noise, spread, log10_scale, seed):
    """Also far beyond what is promised to be exact: precisions of up to e^60 and features of up to 10^8."""
    process = KernelGaussian(k)
    seen = draw_observations(seed, 3, 40, n_weights=k, log_noise=(log_noise, log_noise), spread=spread)
    mean, phi, noise_var = seen.features
    features = Features(mean, 10**log10_scale * phi, noise_var)
    statistics = process.prefixes(features, seen.z)
    for _, var in (
        process.posterior_moments(statistics),
        process.predictive_moments(at(statistics, slice(None), slice(1, None)), features),
    ):
        assert var.isfinite().all() and (var > 0).all()
    assert process.log_evidence(statistics).isfinite().all() and (process.distance(statistics).beta >= 0).all()
    assert process.one_step_log_predictives(features, seen.z).isfinite().all()


@settings(max_examples=6)
@given(st.integers(1, 3), st.integers(1, 3), seeds)
def test_gradients_are_those_of_finite_differences(k, m, seed):
    process, (features, z) = process_of(k), draw_observations(seed, 3, n_weights=k, n_values=m)

    def results(mean, weights, log_noise_var):
        given = Features(mean, weights, log_noise_var.exp())
        prefixes = process.prefixes(given, z)
        before = at(prefixes, slice(3))
        return (
            *process.posterior_moments(prefixes),
            *process.predictive_moments(before, given),
            process.one_step_log_predictives(given, z),
            process.log_evidence(prefixes),
        )

    inputs = (features.mean, features.weights, features.noise_var.log())
    assert th.autograd.gradcheck(results, tuple(part.clone().requires_grad_() for part in inputs), atol=1e-5, rtol=1e-4)


SCORES = {
    "one-step log-predictives": lambda process, features, z: process.one_step_log_predictives(features, z),
    "log-evidence": lambda process, features, z: process.log_evidence(process.statistics(features, z)),
    "means": lambda process, features, z: process.posterior_moments(process.prefixes(features, z))[0],
    "log-variances": lambda process, features, z: process.posterior_moments(process.prefixes(features, z))[1].log(),
}


@hard
@pytest.mark.parametrize("score", SCORES)
def test_gradients_in_float32_are_those_in_float64(kind, score):
    seen = draw_observations(3, 2, 100, n_weights=32, **HARD[kind]).to(th.float32)
    gradients = []
    for process, dtype in ((KernelGaussian(32), th.float32), (process_of(32), th.float64)):
        features, z = seen.to(dtype)
        features = Features(*(part.requires_grad_() for part in features))
        total = SCORES[score](process, features, z).sum()
        gradients.append(th.autograd.grad(total, features, allow_unused=True, materialize_grads=True))
    for found, truth in zip(*gradients, strict=True):
        assert found.isfinite().all() and (found - truth).norm() <= 1e-3 * truth.norm()


@pytest.mark.parametrize("size", [1, 2, 5])
def test_inverse_factor_is_the_cholesky_factor_of_the_inverse(size):
    root = th.as_tensor(np.random.default_rng(0).normal(size=(3, size, size + 2)))
    matrix = root @ root.mT
    factor = inverse_factor(matrix)
    th.testing.assert_close(factor, th.linalg.cholesky(th.linalg.inv(matrix)), **EXACT)
    th.testing.assert_close(log_det(factor).squeeze(-1), th.linalg.slogdet(matrix)[1], **EXACT)


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="n_weights"):
        KernelGaussian(0)
