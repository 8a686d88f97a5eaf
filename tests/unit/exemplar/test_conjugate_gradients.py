"""Conjugate gradients against the direct solution."""

from __future__ import annotations

import numpy as np

from meshdeform.exemplar.conjugate_gradients import conjugate_gradients
from tests.cases import each_case


@each_case(("precision", "off"), [(np.float64, 1e-9), (np.float32, 1e-3)])
def test_the_solution_is_the_direct_one(precision: type, off: float) -> None:
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(60, 30))
    matrix = (rows.T @ rows + np.diag(rng.uniform(1, 100, 30))).astype(precision)
    right = rng.normal(size=30).astype(precision)
    found = conjugate_gradients(matrix.__matmul__, matrix.diagonal(), right, steps=60, enough=1e-24)
    assert found.dtype == precision
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), atol=off * np.abs(right).max())


def test_nothing_is_the_solution_for_nothing() -> None:
    nothing = conjugate_gradients(np.eye(3).__matmul__, np.ones(3), np.zeros(3), steps=5, enough=1e-6)
    np.testing.assert_array_equal(nothing, np.zeros(3))
