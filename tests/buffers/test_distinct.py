"""Places drawn in many pools at once are distinct, and uniform in every order."""

import numpy as np
import pytest

from sb3_bruno.buffers.distinct import FEW, distinct_places


def test_pools_of_all_sizes_share_a_draw():
    sizes = np.array([1, 3, 8, 9, 31, 32, 33, 1_000_000])
    for seed in range(50):
        places = distinct_places(sizes, 8, np.random.default_rng(seed))
        assert places.shape == (8, 8) and (places >= 0).all() and (places < sizes[:, None]).all()
        distinct = [len(set(row)) for row in places.tolist()]
        assert distinct[0] == 1 and distinct[2:] == [8] * 6


@pytest.mark.parametrize("size", [3, 4, 2 * FEW, 2 * FEW + 1, 12])
def test_every_ordered_pair_is_equally_likely(size):
    n = 20_000
    first, second = distinct_places(np.full(n, size), 2, np.random.default_rng(0)).T
    counts = np.bincount(size * first + second, minlength=size * size).reshape(size, size)
    assert (np.diag(counts) == 0).all()
    expected = n / (size * (size - 1))
    assert np.abs(counts[~np.eye(size, dtype=bool)] - expected).max() < 5 * np.sqrt(expected)
