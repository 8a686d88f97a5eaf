"""Factor the linear systems of a surface and of a lattice, solve with the factor, and differentiate the solution.

A grounded Laplacian is factored as L D L^T, sparsely. QDLDL computes the factor, but solves for one right-hand side per
call. The triangular solves are therefore compiled here for all three coordinates in one pass over L. They are serial
and in a fixed order, so every run gives the same bits.

Source: Davis 2006, Direct Methods for Sparse Linear Systems, chapters 3 and 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import qdldl
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.geometry.kernels import kernel

__all__ = ["Factor", "LinearSystem", "factorise", "solve_linear"]

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_SMALLEST_PIVOT = 1e-13
"""Smallest pivot relative to its diagonal entry; below this, cancellation has consumed all digits."""


@dataclass(frozen=True)
class Factor:
    """Factorisation P A P^T = (I + L) D (I + L)^T of the free rows of a matrix.

    Attributes
    ----------
    n_rows : int
        Number of rows of the whole matrix, including the grounded ones.
    free : (n,) int64
        Row of the whole matrix for each row of the factor.
    indptr, indices, data
        L in compressed columns, without its unit diagonal.
    inverse_pivots : (n,) float64
    """

    n_rows: int
    free: _Index
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


class LinearSystem(Protocol):
    """A linear map from Jacobians to positions, and its transpose."""

    def _forward(self, jacobians: _Floats) -> _Floats:
        """Return the positions (N, 3) for Jacobians (E, 3, 3)."""

    def _backward(self, gradient: _Floats) -> _Floats:
        """Return the gradient (E, 3, 3) for a gradient (N, 3) on the positions."""


def solve_linear(system: LinearSystem, jacobians: Tensor, known: Tensor | None = None) -> Tensor:
    """Return the system's positions (N, 3) float64, differentiable once in the Jacobians.

    Parameters
    ----------
    system : LinearSystem
    jacobians : (E, 3, 3) float64
    known : (N, 3) float64, optional
        The positions, if they have already been computed; then only the gradient is computed.
    """
    result: Tensor = _Solve.apply(system, jacobians, known)  # type: ignore[no-untyped-call]
    return result


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, system: LinearSystem, jacobians: Tensor, known: Tensor | None) -> Tensor:
        ctx.system = system  # type: ignore[attr-defined]
        if known is not None:
            return known.clone()
        return torch.from_numpy(system._forward(jacobians.detach().numpy()))

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[None, Tensor, None]:
        system: LinearSystem = ctx.system  # type: ignore[attr-defined]
        return None, torch.from_numpy(system._backward(gradient.numpy())), None
