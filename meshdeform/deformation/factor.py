"""Factor the sparse matrices of surfaces and lattices, and solve with the factor.

A grounded Laplacian is factored as L D L^T. QDLDL (Apache-2.0) computes the factor, but solves for one right-hand side
per call. The triangular solves are therefore compiled here for all three coordinates in one pass over L. They are
serial and in a fixed order, so every run gives the same bits.

Source: Davis 2006, Direct Methods for Sparse Linear Systems, chapters 3 and 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import qdldl
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.geometry.kernels import kernel

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_SMALLEST_PIVOT = 1e-13
"""Smallest pivot relative to its diagonal entry; below this, cancellation has consumed all digits."""


@dataclass(frozen=True)
class Factor:
    """Factorisation P A P^T = (I + L) D (I + L)^T of the free rows of a matrix."""

    n_rows: int  # number of rows of the whole matrix, including the grounded ones
    free: _Index  # row of the whole matrix for each row of the factor
    # L in compressed columns, without its unit diagonal
    indptr: _Index
    indices: _Index
    data: _Floats
    inverse_pivots: _Floats

    def solve(self, right: _Floats) -> _Floats:
        """Solve for right-hand sides (n_rows, 3) float64; grounded rows of the solution are zero."""
        out = np.zeros((self.n_rows, 3))
        _solve(self.indptr, self.indices, self.data, self.inverse_pivots, self.free, np.ascontiguousarray(right), out)
        return out


def factorise(matrix: sparse.csr_matrix, free: _Index) -> Factor | None:
    """Factor the symmetric matrix without its grounded rows.

    Parameters
    ----------
    matrix : (N, N) float64
    free : (n,) int64
        The rows that are not grounded.

    Returns
    -------
    Factor, or None if the matrix is not positive definite to float64 precision.
    """
    if not len(free):
        none = np.zeros(0, np.int64)
        return Factor(matrix.shape[0], none, np.zeros(1, np.int64), none, np.zeros(0), np.zeros(0))
    system = matrix[free][:, free].tocsc()
    if not np.isfinite(system.data).all():
        return None
    try:
        lower, pivots, order = qdldl.Solver(system).factors()
    except RuntimeError:
        return None
    order = np.asarray(order, np.int64)
    if not (pivots > _SMALLEST_PIVOT * system.diagonal()[order]).all() or not np.isfinite(lower.data).all():
        return None
    lower.sort_indices()
    return Factor(
        matrix.shape[0],
        free[order],
        lower.indptr.astype(np.int64),
        lower.indices.astype(np.int64),
        lower.data,
        1.0 / pivots,
    )


@kernel
def _solve(
    indptr: _Index,
    indices: _Index,
    data: _Floats,
    inverse_pivots: _Floats,
    free: _Index,
    right: _Floats,
    out: _Floats,
) -> None:
    n = free.size
    work = np.empty((n, 3))
    for i in range(n):
        for c in range(3):
            work[i, c] = right[free[i], c]
    for j in range(n):
        x, y, z = work[j, 0], work[j, 1], work[j, 2]
        for k in range(indptr[j], indptr[j + 1]):
            value, i = data[k], indices[k]
            work[i, 0] -= value * x
            work[i, 1] -= value * y
            work[i, 2] -= value * z
    for j in range(n - 1, -1, -1):
        pivot = inverse_pivots[j]
        x, y, z = work[j, 0] * pivot, work[j, 1] * pivot, work[j, 2] * pivot
        for k in range(indptr[j], indptr[j + 1]):
            value, i = data[k], indices[k]
            x -= value * work[i, 0]
            y -= value * work[i, 1]
            z -= value * work[i, 2]
        work[j, 0] = x
        work[j, 1] = y
        work[j, 2] = z
    for i in range(n):
        for c in range(3):
            out[free[i], c] = work[i, c]
