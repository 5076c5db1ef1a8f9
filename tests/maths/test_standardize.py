"""Running statistics agree with NumPy's, and the affine map can be undone."""

import numpy as np
import torch as th
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno.maths.standardize import Standardize


def test_the_first_batch_is_standardised_exactly():
    standardize, x = Standardize(3), 5 + 2 * th.randn(400, 3, generator=th.Generator().manual_seed(0))
    standardize.update(x)
    np.testing.assert_allclose(standardize(x).mean(dim=0), 0, atol=1e-5)
    np.testing.assert_allclose(standardize(x).std(dim=0, correction=0), 1, rtol=1e-4)


def test_early_batches_weigh_alike_and_late_ones_are_forgotten():
    standardize = Standardize(1, momentum=0.1)
    for value in range(5):
        standardize.update(th.full((10, 1), float(value)))
    assert standardize.mean.item() == 2
    for _ in range(200):
        standardize.update(th.full((10, 1), 100.0))
    assert abs(standardize.mean.item() - 100) < 1e-3 and standardize.var.item() < 0.1


@given(st.integers(0, 2**31), st.floats(-1e3, 1e3), st.floats(1e-2, 1e3))
def test_inverse_undoes_forward(seed, mean, scale):
    generator = th.Generator().manual_seed(seed)
    standardize = Standardize(2).double()
    x = mean + scale * th.randn(5, 7, 2, generator=generator, dtype=th.float64)
    standardize.update(x)
    th.testing.assert_close(standardize.inverse(standardize(x)), x)


def test_what_never_changes_stays_finite():
    standardize = Standardize(1)
    standardize.update(th.full((10, 1), 3.0))
    assert standardize(th.tensor([3.0])).item() == 0
    assert standardize(th.tensor([4.0])).isfinite()
