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
def test_inverse_undoes_forward_far_out_too(seed, mean, scale):
    generator = th.Generator().manual_seed(seed)
    standardize = Standardize(2).double()
    x = mean + scale * th.randn(5, 7, 2, generator=generator, dtype=th.float64)
    standardize.update(x)
    far = mean + scale * 10.0 ** th.arange(7, dtype=th.float64)[:, None].expand(-1, 2)
    for numbers in (x, far, -far):
        th.testing.assert_close(standardize.inverse(standardize(numbers)), numbers)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_the_log_determinant_is_autograds(x1, x2):
    standardize = Standardize(2).double()
    standardize.update(th.tensor([[1.0, 2.0], [3.0, 8.0]], dtype=th.float64))
    x = th.tensor([x1, x2], dtype=th.float64)
    jacobian = th.autograd.functional.jacobian(standardize, x)
    th.testing.assert_close(standardize.log_det(standardize(x)), jacobian.det().log())


def test_what_lies_far_out_stays_in_reach_in_order_and_finite():
    standardize = Standardize(1)
    standardize.update(th.randn(1_000, 1, generator=th.Generator().manual_seed(0)))
    y = standardize(th.tensor([[1.0], [20.0], [1e3], [1e6], [1e9]]))
    assert (y.diff(dim=0) > 0).all() and y.max() < 32
    assert th.isfinite(standardize.inverse(th.tensor([[1e3]]))).all()


def test_what_never_changes_stays_finite():
    standardize = Standardize(1)
    standardize.update(th.full((10, 1), 3.0))
    assert standardize(th.tensor([3.0])).item() == 0
    assert standardize(th.tensor([4.0])).item() == 1


@given(st.sampled_from([1e-4, 1.0, 1e4]))
def test_small_numbers_are_numbers_too(scale):
    standardize, x = Standardize(1), scale * th.randn(400, 1, generator=th.Generator().manual_seed(0))
    standardize.update(x)
    np.testing.assert_allclose(standardize(x).std(dim=0, correction=0), 1, rtol=1e-3)


@given(st.sampled_from([1e3, 1e6, 1e9]), st.sampled_from([0, 1, 30, 2_000]), st.sampled_from([100, 1_000]))
def test_an_outlier_of_any_size_at_any_time_moves_the_statistics_by_little(size, before, n):
    """The outlier is in every batch, as it is while a replay buffer holds few transitions."""
    generator = th.Generator().manual_seed(0)
    standardize = Standardize(1)
    for _ in range(before):
        standardize.update(th.randn(n, 1, generator=generator))
    for _ in range(50):
        standardize.update(th.cat([th.randn(n - 1, 1, generator=generator), th.tensor([[size]])]))
    assert abs(standardize.mean.item()) < 0.3 and 0.9 < standardize.std.item() < 1.5


def test_a_new_scale_is_followed():
    generator = th.Generator().manual_seed(0)
    standardize = Standardize(1)
    for scale in [1.0] * 2_000 + [1e4] * 5_000:
        standardize.update(scale * th.randn(500, 1, generator=generator))
    assert 0.9e4 < standardize.std.item() < 1.1e4


def test_the_first_reward_after_many_zeros_is_noticed():
    standardize = Standardize(1)
    for _ in range(100):
        standardize.update(th.zeros(50, 1))
    standardize.update(th.tensor([[0.0]] * 49 + [[1.0]]))
    assert standardize.mean.item() > 0 and standardize.std.item() < 1
