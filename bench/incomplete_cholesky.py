"""Conjugate gradients with an incomplete Cholesky factor of the matrix's own pattern, IC(0): a peer of the solve.

scipy has no incomplete Cholesky factor, and its incomplete LU factor is not symmetric, so conjugate gradients need not
converge with it.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

__all__ = ["IncompleteCholesky"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


@njit  # type: ignore[untyped-decorator]
def _factor(indptr: Ints, indices: Ints, data: Floats) -> None:
    """Replace the lower triangle, rows sorted and the diagonal last in each, by its incomplete factor."""
    for i in range(len(indptr) - 1):
        start, diagonal = indptr[i], indptr[i + 1] - 1
        for at in range(start, indptr[i + 1]):
            k = indices[at]
            a, b, total = start, indptr[k], data[at]
            while a < at and indices[b] < k:
                if indices[a] == indices[b]:
                    total -= data[a] * data[b]
                    a, b = a + 1, b + 1
                elif indices[a] < indices[b]:
                    a += 1
                else:
                    b += 1
            data[at] = np.sqrt(total) if at == diagonal else total / data[indptr[k + 1] - 1]


@njit  # type: ignore[untyped-decorator]
def _solve(indptr: Ints, indices: Ints, data: Floats, right: Floats) -> Floats:
    x = right.copy()
    for i in range(len(x)):
        diagonal = indptr[i + 1] - 1
        for at in range(indptr[i], diagonal):
            x[i] -= data[at] * x[indices[at]]
        x[i] /= data[diagonal]
    for i in range(len(x) - 1, -1, -1):
        diagonal = indptr[i + 1] - 1
        x[i] /= data[diagonal]
        for at in range(indptr[i], diagonal):
            x[indices[at]] -= data[at] * x[i]
    return x


class IncompleteCholesky:
    """Factor of a symmetric positive definite (n, n) matrix; raises FloatingPointError where IC(0) breaks down."""

    def __init__(self, matrix: sparse.csc_matrix) -> None:
        lower = sparse.tril(matrix, format="csr")
        lower.sort_indices()
        self._matrix = matrix.tocsr()
        self._parts = lower.indptr, lower.indices, lower.data
        _factor(*self._parts)
        if not np.isfinite(lower.data).all():
            raise FloatingPointError("a pivot is not positive")
        self._preconditioner = LinearOperator(matrix.shape, lambda right: _solve(*self._parts, right.ravel()))

    def solve(self, right: Floats, start: Floats, tolerance: float) -> Floats:
        """Return x of `right` (n, k), from the guess `start`, to a relative residual of `tolerance`."""
        found = []
        for c in range(right.shape[1]):
            x, failed = cg(self._matrix, right[:, c], x0=start[:, c], rtol=tolerance, M=self._preconditioner)
            assert not failed
            found.append(x)
        return np.stack(found, 1)
