"""The evidence of a process with a kernel under priors other than its own, against dense densities."""

import numpy as np
import pytest
import torch as th
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, multivariate_t

from sb3_bruno.maths.kernel_process import KernelGaussian
from sb3_bruno.maths.kernel_process_t import KernelStudentT
from sb3_bruno.maths.kernel_statistics import Features
from support.kernels import Dense, draw_observations

sizes, lengths, seeds = st.integers(1, 4), st.integers(0, 7), st.integers(0, 2**31)


@given(sizes, sizes, lengths, st.integers(1, 3), seeds)
def test_evidence_under_other_priors_is_the_dense_density(k, m, n, n_priors, seed):
    process, seen = KernelGaussian(k).double(), draw_observations(seed, n, n_weights=k, n_values=m)
    rng = np.random.default_rng(seed)
    mean, var = rng.normal(size=(n_priors, k)), np.exp(rng.normal(size=k))
    found = process.log_evidence_under(process.statistics(*seen), th.as_tensor(mean), th.as_tensor(var))
    assert found.shape == (n_priors,)
    dense = Dense.of(seen)
    noise = dense.cov - dense.phi @ dense.phi.T
    for one, score in zip(mean, found, strict=True):
        cov = noise + dense.phi @ np.diag(var) @ dense.phi.T
        truth = multivariate_normal(np.zeros(n * m), cov).logpdf(dense.error - dense.phi @ one) if n else 0.0
        assert score.item() == pytest.approx(truth, rel=1e-8, abs=1e-8)
    standard = process.log_evidence_under(process.statistics(*seen), th.zeros(1, k), th.ones(k))
    th.testing.assert_close(standard[0], process.log_evidence(process.statistics(*seen)), rtol=1e-9, atol=1e-9)


@given(sizes, sizes, st.integers(1, 7), st.floats(2.1, 100.0), seeds)
def test_evidence_under_another_prior_is_the_dense_t(k, m, n, df, seed):
    process, seen = KernelStudentT(k, df=df).double(), draw_observations(seed, n, n_weights=k, n_values=m)
    rng = np.random.default_rng(seed)
    mean, var, dense = rng.normal(size=k), np.exp(rng.normal(size=k)), Dense.of(seen)
    found = process.log_evidence_under(process.statistics(*seen), th.as_tensor(mean)[None], th.as_tensor(var)).item()
    cov = dense.cov + dense.phi @ np.diag(var - 1) @ dense.phi.T
    df = process.df.item()  # which was rounded to float32; SciPy takes a shape matrix
    truth = multivariate_t(dense.phi @ mean, cov * (df - 2) / df, df=df).logpdf(dense.error)
    assert found == pytest.approx(truth, rel=1e-8, abs=1e-8)


def test_a_bayes_factor_is_rounded_once():
    """Of two log-densities of -1e5, in float32 each is right to .004 and their difference to no digit."""
    process, seen = KernelGaussian(3), draw_observations(0, 40, n_weights=3, n_values=2)
    single = [part.float() for part in (*seen[0], seen[1])]
    features, z = Features(*single[:3]), single[3]
    statistics = process.statistics(features, z)
    new = Features(*(part[0] for part in features))
    far = 300.0 * new.noise_var.sqrt() + z[0]
    exact = KernelGaussian(3).double()
    known = exact.statistics(features.double(), z.double())
    truth = exact.log_bayes_factor(known, new.double(), far.double())
    assert abs(exact.log_predictive(known, new.double(), far.double())) > 3e4
    assert process.log_bayes_factor(statistics, new, far).item() == pytest.approx(truth.item(), rel=1e-5)
