"""Interpolation between scattered points by inverse squared distance, against values by hand."""

from __future__ import annotations

import numpy as np

from meshdeform.geometry.scattered import interpolate

POINTS = np.array([[0.0, 0, 0], [3.0, 0, 0], [100.0, 0, 0], [200.0, 0, 0], [0, 5000.0, 0]])
VALUES = np.array([[1.0], [2.0], [0.0], [0.0], [1e9]])


def test_weights_are_inverse_squared_distances_of_the_four_nearest() -> None:
    weights = 1 / np.array([1.0, 2.0, 99.0, 199.0]) ** 2
    expected = (weights * [1, 2, 0, 0]).sum() / weights.sum()
    np.testing.assert_allclose(interpolate(POINTS, VALUES, np.array([[1.0, 0, 0]])), [[expected]], rtol=1e-12)


def test_a_point_itself_has_exactly_its_value_and_doubled_points_their_mean() -> None:
    np.testing.assert_array_equal(interpolate(POINTS, VALUES, POINTS), VALUES)
    doubled = np.concatenate([POINTS[:1], POINTS])
    np.testing.assert_array_equal(interpolate(doubled, np.concatenate([[[3.0]], VALUES]), POINTS[:1]), [[2.0]])


def test_one_point_is_enough() -> None:
    np.testing.assert_array_equal(interpolate(POINTS[:1], VALUES[:1], POINTS + 7), np.ones((5, 1)))
