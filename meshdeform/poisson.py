"""Positions from Jacobians: the mesh whose gradients are nearest to given ones.

Minimises  sum_f |f| ||grad_f(verts) - J_f||^2,  that is  L verts = G^T M J  with the cotangent Laplacian L = G^T M G
of the rest mesh. L is factored once; every solve and every backward pass is a pair of triangular solves.

Gauge: the energy does not see translations of a connected component. One vertex of each component is pinned to make L
definite, then the component is moved so that its centroid (by the rest mesh's vertex areas) is the rest mesh's.

Faces without area, and needles so thin that 1 / |f| would drown everything else in float64 (`collapsed_faces`), have
weight 0 in the energy. So that they still hold together what they connect, each of their edges e becomes a weak
spring  w ||(v_j - v_i) - J_f e||^2,  w = 1e-4 longest edge / max(|e|, 1e-3 longest edge): dimensionless like the
cotangents, so independent of units. A vertex within a collapsed edge follows that edge linearly. If the
factorisation still breaks down, the needle threshold is raised a hundredfold and tried again, twice.

Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 3 and 4; Yu et al. 2004, Poisson mesh editing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
import qdldl
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor
from torch.autograd.function import once_differentiable

from meshdeform.errors import NumericalError, ShapeError
from meshdeform.mesh import TriangleMesh, connected_components
from meshdeform.operators import COLLAPSED_SHAPE, collapsed_faces, gradient_matrix

__all__ = ["PoissonSystem"]

_SPRING = 1e-4
_SHORTEST = 1e-3
_THRESHOLDS = (COLLAPSED_SHAPE, 100 * COLLAPSED_SHAPE, 10_000 * COLLAPSED_SHAPE)
_ADVICE = (
    "Remove needle-shaped or overlapping triangles (merge by distance, dissolve degenerate) and send the mesh again."
)

_Array = NDArray[np.float64]


class _Factor(NamedTuple):
    """P A P^T = (I + L) D (I + L)^T of the pinned Laplacian A, L by columns; `free[k]` is the vertex of row k."""

    indptr: NDArray[np.int64]
    indices: NDArray[np.int64]
    data: _Array
    inverse_pivots: _Array
    free: NDArray[np.int64]


class PoissonSystem:
    """Factored Poisson system of one rest mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        The rest mesh: any triangle soup.

    Attributes
    ----------
    components : (V,) int64
        Connected component of each vertex.
    n_components : int
        Components that have faces; isolated vertices are not counted and keep their place.
    face_weights : (F,) float64
        Areas, zero for collapsed faces.
    collapsed : (F,) bool
        Faces that the energy leaves out.

    Raises
    ------
    NumericalError
        The factorisation failed for every needle threshold.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self.n_verts, self.n_faces = mesh.n_verts, mesh.n_faces
        self.components = connected_components(mesh.faces, mesh.n_verts)
        labels = self.components.numpy()
        # Solved in a unit frame: neither huge nor tiny coordinates reach the factor.
        self._scale = mesh.diagonal or 1.0
        self._rest = mesh.verts.numpy().copy()
        centre = mesh.verts.sum(0) / max(mesh.n_verts, 1)
        unit = TriangleMesh((mesh.verts - centre) / self._scale, mesh.faces)
        pinned = _pins(mesh, labels)
        for threshold in _THRESHOLDS:
            self.collapsed = collapsed_faces(unit.verts, unit.faces, threshold)
            laplacian, to_rhs, areas = _assemble(unit, self.collapsed.numpy(), threshold)
            factor = _factorise(laplacian, pinned)
            if factor is not None:
                break
        else:
            raise NumericalError("the Poisson system of this mesh cannot be factored", advice=_ADVICE)
        self._factor = factor
        self._to_rhs = to_rhs
        self._from_adjoint = to_rhs.T.tocsr()
        self.face_weights = torch.from_numpy(areas * self._scale**2)
        isolated = np.ones(mesh.n_verts, bool)
        isolated[mesh.faces.numpy()] = False
        self.n_components = len(np.unique(labels[~isolated]))
        self._labels = labels
        self._centroid_weights = _centroid_weights(mesh, areas, labels)
        self._rest_centroids = self._component_sums(self._centroid_weights[:, None] * self._rest)

    def solve(self, jacobians: Tensor) -> Tensor:
        """Positions whose gradients are nearest to the Jacobians.

        Parameters
        ----------
        jacobians : (F, 3, 3) float64
            Dimensionless, `edge_new = J @ edge_old`, on any device (the solve runs on the CPU).

        Returns
        -------
        (V, 3) float64, object units, on the Jacobians' device; differentiable once. Each component's centroid is the
        rest mesh's, isolated vertices are where they were. The same input gives the same bits.

        Raises
        ------
        ShapeError
            Not (F, 3, 3) float64.
        NumericalError
            The Jacobians hold NaN or infinite entries.
        """
        if jacobians.shape != (self.n_faces, 3, 3) or jacobians.dtype != torch.float64:
            raise ShapeError(
                f"expected jacobians ({self.n_faces}, 3, 3) float64, got {tuple(jacobians.shape)} {jacobians.dtype}"
            )
        verts: Tensor = _PoissonSolve.apply(jacobians, self)  # type: ignore[no-untyped-call]
        return verts

    def _forward(self, jacobians: _Array) -> _Array:
        # Column c of the right-hand side takes row c of every Jacobian: the gradient of coordinate c.
        field = np.ascontiguousarray(jacobians.transpose(0, 2, 1)).reshape(-1, 3)
        moved = self._invert(self._to_rhs, field)
        if not np.isfinite(moved).all():
            raise NumericalError("the Jacobians hold NaN or infinite entries, so the solve has no answer")
        moved *= self._scale
        shift = self._rest_centroids - self._component_sums(self._centroid_weights[:, None] * moved)
        moved += shift[self._labels]
        return moved

    def _adjoint(self, gradient: _Array) -> _Array:
        """Transpose of `_forward`'s linear part."""
        free = gradient - self._centroid_weights[:, None] * self._component_sums(gradient)[self._labels]
        free *= self._scale
        field = np.zeros((3 * self.n_faces, 3))
        solved = np.zeros_like(free)
        _triangular_solves(*self._factor, free, solved)
        _multiply(self._from_adjoint.indptr, self._from_adjoint.indices, self._from_adjoint.data, solved, field)
        return np.ascontiguousarray(field.reshape(-1, 3, 3).transpose(0, 2, 1))

    def _invert(self, to_rhs: sparse.csr_matrix, field: _Array) -> _Array:
        right_hand_side = np.zeros((self.n_verts, 3))
        _multiply(to_rhs.indptr, to_rhs.indices, to_rhs.data, field, right_hand_side)
        solved = np.zeros_like(right_hand_side)
        _triangular_solves(*self._factor, right_hand_side, solved)
        return solved

    def _component_sums(self, values: _Array) -> _Array:
        """Sum (V, 3) over each component, in vertex order."""
        count = int(self._labels.max(initial=-1)) + 1
        return np.stack([np.bincount(self._labels, values[:, c], minlength=count) for c in range(3)], 1)


class _PoissonSolve(torch.autograd.Function):
    """The solve is linear and its matrix symmetric, so its backward pass is the same factor once more."""

    @staticmethod
    def forward(ctx: Any, jacobians: Tensor, system: PoissonSystem) -> Tensor:
        ctx.system = system
        return torch.from_numpy(system._forward(jacobians.detach().cpu().numpy())).to(jacobians.device)

    @staticmethod
    @once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        field = ctx.system._adjoint(gradient.detach().cpu().numpy())
        return torch.from_numpy(field).to(gradient.device), None


def _pins(mesh: TriangleMesh, labels: NDArray[np.int64]) -> NDArray[np.bool_]:
    """One vertex of each component (V,): the first."""
    pinned = np.zeros(mesh.n_verts, bool)
    pinned[np.unique(labels, return_index=True)[1]] = True
    return pinned


def _assemble(
    mesh: TriangleMesh, collapsed: NDArray[np.bool_], threshold: float
) -> tuple[sparse.csr_matrix, sparse.csr_matrix, _Array]:
    """L (V, V), the right-hand side's operator (V, 3F) and the face weights (F,)."""
    points, corners = mesh.verts.numpy(), mesh.faces.numpy()
    gradient = gradient_matrix(mesh.verts, mesh.faces, threshold)
    edge = points[corners[:, [1, 2, 0]]] - points[corners]
    areas = 0.5 * np.linalg.norm(np.cross(edge[:, 0], -edge[:, 2]), axis=1)
    areas[collapsed] = 0.0
    to_rhs = (gradient.T @ sparse.diags(np.repeat(areas, 3))).tocsr()
    laplacian = to_rhs @ gradient
    f = np.flatnonzero(collapsed)
    if f.size:
        lengths = np.linalg.norm(edge[f], axis=2)
        longest = lengths.max(1, keepdims=True)
        longest[longest == 0] = 1.0
        weight = _SPRING * longest / np.maximum(lengths, _SHORTEST * longest)
        # A spring from i to j is a row with -1 and 1; three of them for each collapsed face.
        tail, head = corners[f].reshape(-1), corners[f][:, [1, 2, 0]].reshape(-1)
        row = np.arange(tail.size)
        ends = np.concatenate([tail, head]), np.concatenate([row, row])
        difference = sparse.coo_matrix(
            (np.concatenate([-np.ones(tail.size), np.ones(tail.size)]), ends), shape=(mesh.n_verts, tail.size)
        ).tocsr()
        weighted = difference @ sparse.diags(weight.reshape(-1))
        columns = 3 * np.repeat(f, 3)[:, None] + np.arange(3)
        targets = sparse.coo_matrix(
            (edge[f].reshape(-1), (np.repeat(row, 3), columns.reshape(-1))), shape=(tail.size, 3 * len(corners))
        )
        laplacian = laplacian + weighted @ difference.T
        to_rhs = to_rhs + weighted @ targets
    to_rhs = to_rhs.tocsr()
    to_rhs.sort_indices()
    return laplacian.tocsr(), to_rhs, areas


def _centroid_weights(mesh: TriangleMesh, areas: _Array, labels: NDArray[np.int64]) -> _Array:
    """Weights (V,) that sum to 1 in each component: vertex areas, or equal ones where a component has no area."""
    share = np.bincount(mesh.faces.numpy().reshape(-1), np.repeat(areas / 3, 3), minlength=mesh.n_verts)
    total = np.bincount(labels, share)
    share = np.where(total[labels] > 0, share, 1.0)
    weights: _Array = share / np.bincount(labels, share)[labels]
    return weights


def _factorise(laplacian: sparse.csr_matrix, pinned: NDArray[np.bool_]) -> _Factor | None:
    """Factor the Laplacian without the pinned rows; None where it is not positive definite in float64."""
    free = np.flatnonzero(~pinned)
    if not free.size:
        nothing = np.empty(0, np.int64)
        return _Factor(np.zeros(1, np.int64), nothing, np.empty(0), np.empty(0), nothing)
    system = laplacian[free][:, free].tocsc()
    try:
        lower, pivots, order = qdldl.Solver(system).factors()
    except RuntimeError:
        return None
    pivots = np.asarray(pivots)
    # A pivot lost to cancellation is as useless as a negative one: compare with the row it came from.
    order = np.asarray(order, np.int64)
    if not (pivots > 1e-14 * system.diagonal()[order]).all() or not np.isfinite(lower.data).all():
        return None
    lower.sort_indices()
    return _Factor(lower.indptr.astype(np.int64), lower.indices.astype(np.int64), lower.data, 1.0 / pivots, free[order])


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _multiply(indptr, indices, data, dense, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Write the product of a CSR matrix and a dense (., 3) one to `out`."""
    for row in range(indptr.size - 1):
        x, y, z = 0.0, 0.0, 0.0
        for k in range(indptr[row], indptr[row + 1]):
            value, column = data[k], indices[k]
            x += value * dense[column, 0]
            y += value * dense[column, 1]
            z += value * dense[column, 2]
        out[row, 0], out[row, 1], out[row, 2] = x, y, z


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _triangular_solves(indptr, indices, data, inverse_pivots, free, b, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Solve with the factor for three right-hand sides at once; rows of `out` that are not free stay as they are."""
    n = free.size
    x = np.empty((n, 3))
    for i in range(n):
        for c in range(3):
            x[i, c] = b[free[i], c]
    for j in range(n):
        x0, x1, x2 = x[j, 0], x[j, 1], x[j, 2]
        for k in range(indptr[j], indptr[j + 1]):
            value, i = data[k], indices[k]
            x[i, 0] -= value * x0
            x[i, 1] -= value * x1
            x[i, 2] -= value * x2
    for j in range(n - 1, -1, -1):
        pivot = inverse_pivots[j]
        x0, x1, x2 = x[j, 0] * pivot, x[j, 1] * pivot, x[j, 2] * pivot
        for k in range(indptr[j], indptr[j + 1]):
            value, i = data[k], indices[k]
            x0 -= value * x[i, 0]
            x1 -= value * x[i, 1]
            x2 -= value * x[i, 2]
        x[j, 0], x[j, 1], x[j, 2] = x0, x1, x2
    for i in range(n):
        for c in range(3):
            out[free[i], c] = x[i, c]
