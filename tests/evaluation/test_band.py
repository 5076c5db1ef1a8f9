"""A band is the mean and the middle half of samples, and NaN is no sample."""

from __future__ import annotations

import warnings

import numpy as np

from sb3_bruno.evaluation.band import Band

NAN = np.nan


def test_a_band_is_mean_and_middle_half_of_what_is_known() -> None:
    samples = np.array([[1.0, 2.0, NAN], [3.0, NAN, NAN], [8.0, 4.0, NAN], [0.0, NAN, NAN], [9.0, NAN, NAN]])
    with warnings.catch_warnings(action="error"):
        band = Band.of(np.array([10, 20, 30]), samples)
    np.testing.assert_array_equal(np.stack(band), [[10, 20, 30], [4.2, 3, NAN], [1, 2.5, NAN], [8, 3.5, NAN]])


def test_the_range_may_be_that_of_other_samples() -> None:
    band = Band.of(np.array([1, 2]), np.array([[1.0, 2.0]]), np.array([[0.0, 5.0], [3.0, 4.0]]))
    np.testing.assert_array_equal(np.stack(band), [[1, 2], [1, 2], [0.75, 4.25], [2.25, 4.75]])


def test_single_precision_is_averaged_in_double() -> None:
    samples = np.full((3, 1), 0.1, dtype=np.float32)
    band = Band.of(np.array([1]), samples)
    assert band.mean.dtype == np.float64 and band.mean[0] == np.float64(np.float32(0.1))
