"""The Student-t process agrees with an independent slow truth: SciPy's dense multivariate t in float64."""

import numpy as np
import pytest
import torch as th
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import f, invgamma, kstest, multivariate_t

from sb3_bruno.maths.exchangeable import ExchangeableGaussian
from sb3_bruno.maths.exchangeable_t import ExchangeableStudentT

correlations = st.floats(1e-2, 0.99)
variances = st.floats(1e-2, 1e2)
dfs = st.floats(2.1, 100.0)
lengths = st.integers(0, 8)
seeds = st.integers(0, 2**31)
DIM = 3


def process_of(var: float, correlation: float, df: float, shared_scale: bool, dim: int = DIM) -> ExchangeableStudentT:
    return ExchangeableStudentT(dim, var=var, correlation=correlation, df=df, shared_scale=shared_scale).double()


def draw(seed: int, *shape: int) -> th.Tensor:
    return th.as_tensor(np.random.default_rng(seed).normal(size=shape))


def dense(process: ExchangeableStudentT, z: np.ndarray, theta: np.ndarray | None = None) -> float:
    """Return the log-density of z, ``(n, dim)``, and of theta, ``(dim,)``, if given, by one dense t for each scale.

    SciPy takes a shape matrix, which is (nu - 2) / nu times the covariance.
    """
    var, cov = process.var.detach().numpy(), process.cov.detach().numpy()
    blocks, values = [], []
    for d in range(z.shape[1]):
        block = np.full((len(z), len(z)), cov[d]) + (var[d] - cov[d]) * np.eye(len(z))
        if theta is not None:  # theta's variance and all its covariances are rho
            block = np.pad(block, ((0, 1), (0, 1)), constant_values=cov[d])
        blocks.append(block)
        values.append(z[:, d] if theta is None else np.append(z[:, d], theta[d]))
    if process.shared_scale:
        size = sum(map(len, blocks))
        whole, at = np.zeros((size, size)), 0
        for block in blocks:
            whole[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        blocks, values = [whole], [np.concatenate(values)]
    total = 0.0
    for nu, block, value in zip(process.df.tolist(), blocks, values, strict=True):
        if len(value):
            total += float(multivariate_t(np.zeros(len(value)), block * (nu - 2) / nu, df=nu).logpdf(value))
    return total


@settings(max_examples=40)
@given(variances, correlations, dfs, st.booleans(), lengths, seeds)
def test_evidence_is_the_dense_density(var, correlation, df, shared_scale, n, seed):
    process, z = process_of(var, correlation, df, shared_scale), draw(seed, n, DIM)
    found = process.log_evidence(process.statistics(z)).item()
    assert found == pytest.approx(dense(process, z.numpy()), rel=1e-8, abs=1e-8)


@settings(max_examples=40)
@given(variances, correlations, dfs, st.booleans(), lengths, seeds)
def test_predictive_is_a_ratio_of_dense_densities(var, correlation, df, shared_scale, n, seed):
    process, z = process_of(var, correlation, df, shared_scale), draw(seed, n + 1, DIM)
    found = process.log_predictive(process.statistics(z[:-1]), z[-1]).item()
    truth = dense(process, z.numpy()) - dense(process, z[:-1].numpy())
    assert found == pytest.approx(truth, rel=1e-7, abs=1e-8)


@settings(max_examples=40)
@given(variances, correlations, dfs, lengths, seeds)
def test_posterior_is_a_ratio_of_dense_densities(var, correlation, df, n, seed):
    """A shared scale makes the dimensions dependent but leaves their marginals, so one dimension is enough."""
    for shared_scale in (False, True):
        process, z, theta = process_of(var, correlation, df, shared_scale, 1), draw(seed, n, 1), draw(seed + 1, 1)
        found = process.posterior(process.statistics(z)).log_prob(theta).item()
        truth = dense(process, z.numpy(), theta.numpy()) - dense(process, z.numpy())
        assert found == pytest.approx(truth, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("shared_scale", [False, True])
def test_moments_are_those_of_the_posterior(shared_scale):
    process = process_of(2.0, 0.3, 5.0, shared_scale)
    statistics = process.prefixes(draw(0, 9, DIM))
    posterior, (mean, var) = process.posterior(statistics), process.posterior_moments(statistics)
    th.testing.assert_close(mean, posterior.mean)
    th.testing.assert_close(var, posterior.variance)
    wide = posterior.expand((3, *posterior.batch_shape))
    assert wide.sample((2,)).shape == (2, 3, 10, DIM) and wide.variance.shape == (3, 10, DIM)


def test_a_shared_scale_is_learned_from_all_dimensions():
    """r_n = (nu - 2 + beta) / (nu + n D - 2) on the Gaussian's variance, beta summed over the dimensions."""
    process, z = process_of(1.0, 0.3, 5.0, True), 3 * draw(0, 7, DIM)
    gaussian = ExchangeableGaussian(DIM, correlation=0.3).double()
    cov = np.full((7, 7), 0.3) + 0.7 * np.eye(7)
    beta = np.einsum("id,ij,jd->", z, np.linalg.inv(cov), z)
    r = (5.0 - 2 + beta) / (5.0 + 7 * DIM - 2)
    assert r > 2
    for name in ("posterior", "predictive"):
        student_t, normal = (getattr(model, name)(model.statistics(z)) for model in (process, gaussian))
        th.testing.assert_close(student_t.mean, normal.mean)
        th.testing.assert_close(student_t.variance, r * normal.variance, rtol=1e-6, atol=0)


@pytest.mark.parametrize("shared_scale", [False, True])
def test_evidence_is_the_product_of_one_step_predictives(shared_scale):
    process, z = process_of(2.0, 0.2, 4.0, shared_scale), draw(1, 5, 12, DIM)
    before = type(process.empty())(*(part[:, :-1] for part in process.prefixes(z)))
    one_step = process.log_predictive(before, z).sum(dim=-1)
    th.testing.assert_close(process.log_evidence(process.statistics(z)), one_step, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("shared_scale", [False, True])
def test_many_degrees_of_freedom_are_the_gaussian(shared_scale):
    z = draw(2, 4, 20, DIM)
    gaussian, process = ExchangeableGaussian(DIM).double(), process_of(1.0, 0.1, 1e9, shared_scale)
    seen, expected = process.prefixes(z), gaussian.prefixes(z)
    th.testing.assert_close(process.posterior(seen).variance, gaussian.posterior(expected).variance, rtol=1e-6, atol=0)
    th.testing.assert_close(process.log_evidence(seen), gaussian.log_evidence(expected), rtol=1e-6, atol=1e-6)
    here = type(expected)(*(part[:, :-1] for part in expected))
    th.testing.assert_close(process.log_predictive(here, z), gaussian.log_predictive(here, z), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("shared_scale", [False, True])
def test_float32_agrees_with_float64_over_ten_thousand_observations(shared_scale):
    z = 3 * draw(3, 10_001, DIM) + 5.0
    exact, single = (
        ExchangeableStudentT(DIM, shared_scale=shared_scale).to(dtype) for dtype in (th.float64, th.float32)
    )
    found = {}
    for process in (exact, single):
        values = z.to(process.log_var.dtype)
        prefixes = process.prefixes(values)
        before = type(prefixes)(*(part[:-1] for part in prefixes))
        posterior = process.posterior(prefixes)
        found[process] = (
            posterior.mean,
            posterior.variance,
            process.log_predictive(before, values),
            process.log_evidence(before) / th.arange(1, 10_002),
        )
    for truth, value in zip(found[exact], found[single], strict=True):
        assert value.isfinite().all()
        np.testing.assert_allclose(value.detach(), truth.detach(), rtol=1e-3, atol=1e-3)


def test_the_variance_depends_on_the_data_and_not_on_their_number_alone():
    process = ExchangeableStudentT(1, correlation=0.3)
    alike, apart = (process.posterior(process.statistics(k * draw(4, 20, 1).float())).variance for k in (0.3, 3.0))
    assert apart > 20 * alike


@pytest.mark.parametrize("shared_scale", [False, True])
def test_samples_have_the_predictives_density(shared_scale):
    th.manual_seed(0)
    process, context = process_of(1.0, 0.4, 6.0, shared_scale), draw(5, 4, DIM)
    statistics = process.statistics(context)
    with th.no_grad():
        samples = process.sample(statistics, 40_000)
        predictive = process.predictive(statistics)
    for d in range(DIM):
        standard = (samples[:, d] - predictive.loc[d]) / predictive.scale[d]
        assert kstest(standard.numpy(), "t", args=(predictive.df[d].item(),)).pvalue > 1e-3
    squares = (samples - predictive.mean).square()
    together = np.corrcoef(squares.log().T)[0, 1]  # what a common scale leaves behind
    assert (together > 0.02) == shared_scale


@pytest.mark.parametrize("shared_scale", [False, True])
def test_distance_follows_the_f_distribution_under_the_model(shared_scale):
    """(beta / k) nu / (nu - 2) ~ F(k, nu), k = n or, with a scale for all dimensions, n D."""
    df, n, rng = 6.0, 10, np.random.default_rng(6)
    process = process_of(1.0, 0.3, df, shared_scale, DIM)
    scale = invgamma(df / 2, scale=(df - 2) / 2).rvs((2_000, 1 if shared_scale else DIM), random_state=rng)
    theta = np.sqrt(0.3 * scale) * rng.normal(size=(2_000, DIM))
    z = theta[:, None] + np.sqrt(0.7 * scale)[:, None] * rng.normal(size=(2_000, n, DIM))
    distance = process.distance(process.statistics(th.as_tensor(z)))
    beta, k, nu = (part.detach().numpy() for part in distance)
    assert beta.shape[-1] == nu.size == (1 if shared_scale else DIM)
    np.testing.assert_array_equal(k, n * DIM if shared_scale else n)
    np.testing.assert_allclose(nu, df)
    for column in beta.T:
        assert kstest(column / k[0] * df / (df - 2), f(k[0, 0], df).cdf).pvalue > 1e-3


def test_gradients_reach_the_degrees_of_freedom():
    process, z = process_of(1.0, 0.2, 5.0, False), draw(7, 6, DIM)

    def evidence(*values):
        names = ("log_var", "correlation_logit", "log_excess_df")
        return th.func.functional_call(process, dict(zip(names, values, strict=True)), ())

    process.forward = lambda: process.log_evidence(process.statistics(z))  # type: ignore[method-assign]
    parameters = (process.log_var, process.correlation_logit, process.log_excess_df)
    inputs = tuple(parameter.detach().clone().requires_grad_() for parameter in parameters)
    assert th.autograd.gradcheck(evidence, inputs, atol=1e-5, rtol=1e-4)


def test_degrees_of_freedom_stay_above_two_and_others_are_refused():
    process = ExchangeableStudentT(2)
    with th.no_grad():
        process.log_excess_df.fill_(-10.0)
    assert (process.df > 2).all()
    with pytest.raises(ValueError, match="df"):
        ExchangeableStudentT(2, df=2.0)
