"""Solve the Poisson equation for vertices with given per-face Jacobians.

    min_v  sum_f |f| ||grad_f(v) - J_f||^2     <=>     L v = G^T M J,   L = G^T M G

The matrix is factored once per mesh. The kernel of L consists of the functions that are constant on each connected
component, so one vertex per component is grounded for the factorisation; the component is then moved to its centre of
mass at rest. The matrix is symmetric, so a backward pass (`differentiable.py`) reuses the same factor. Sources: Xu et
al. 2024, FusionDeformer, eq. 6; Aigerman et al. 2022, Neural Jacobian Fields, eq. 4.

Pinned vertices are eliminated: their rows leave the matrix, and their positions at rest go to the right-hand side. What
remains is positive definite on a component with a pinned vertex, so none is grounded there, and the component is not
moved to its centre of mass: the pinned vertices determine its position.

Vertices on edges of other faces (`geometry/junctions.py`) are eliminated as well: they follow the edges, v = P u + o
with o what they are apart from them at rest. The system of the others u is that of the same energy::

    P^T L P u = P^T (G^T M J - L o)

so both sides deform together, and components that such a vertex joins have one centre of mass.

Collapsed faces (`geometry.COLLAPSED_SHAPE`) have no weight, because their cotangents would swamp all others in
float64. To keep what they connect together, each of their edges e is a weak spring  w ||v_j - v_i - J_f e||^2,
w = 1e-6 longest edge / |e|, dimensionless like the cotangents. Springs have zero energy under every deformation with
consistent Jacobians, and a vertex on the long edge of a collapsed face follows that edge linearly. If the factorisation
still fails, the threshold for collapsed faces is raised to 30 and then to 1,000 times its value.

QDLDL (Apache-2.0) computes the factor; the triangular solves are our own, for all three coordinates at once.

The linear systems of a surface and of a lattice
------------------------------------------------
A grounded Laplacian is factored as L D L^T, sparsely. QDLDL computes the factor, but solves for one right-hand side per
call. The triangular solves are therefore compiled here for all three coordinates in one pass over L. They are serial
and in a fixed order, so every run gives the same bits.

Source: Davis 2006, Direct Methods for Sparse Linear Systems, chapters 3 and 4.

Jacobians of the piecewise-linear map rest -> deformed
------------------------------------------------------
A map of a surface determines how edges are mapped, but not what happens along the normal. Three kinds of Jacobian
follow. That of the map itself sends the rest normal to zero. The optimisation's variables are full 3x3 matrices, of
which the Poisson solve uses the tangential part. Those that transform the asset's normals are completed to full rank.

Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import qdldl
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.errors import NumericalError, ShapeError
from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import RestMesh, TriangleMesh, face_areas, face_normals

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_SMALLEST_PIVOT = 1e-13
"""Smallest pivot relative to its diagonal entry; below this, cancellation has consumed all digits."""

_SHAPES = (COLLAPSED_SHAPE, 30 * COLLAPSED_SHAPE, 1000 * COLLAPSED_SHAPE)
_SPRING = 1e-6

_SHORTEST = 1e-3
"""Lower bound of an edge length of a collapsed face, relative to its longest edge."""


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


class LinearSystem(Protocol):
    """A linear map from Jacobians to positions, and its transpose."""

    def solve(self, jacobians: _Floats) -> _Floats:
        """Return the positions (N, 3) for Jacobians (E, 3, 3)."""

    def solve_transposed(self, gradient: _Floats) -> _Floats:
        """Return the gradient (E, 3, 3) for a gradient (N, 3) on the positions."""


class PoissonSystem:
    """Factored Poisson system of one rest mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        May be open, non-manifold or of several components, with unused vertices (they do not move) and faces without
        area (they have no weight).
    pinned : (V,) bool, optional
        Vertices that stay exactly where they are at rest.

    Attributes
    ----------
    rest : RestMesh
        The mesh, with the `collapsed_shape` that the matrix was factored with. Read from here which faces have no
        weight; do not recompute it.

    Raises
    ------
    NumericalError
        The matrix could not be factored.
    """

    def __init__(self, mesh: TriangleMesh, pinned: NDArray[np.bool_] | None = None) -> None:
        rest = RestMesh.of(mesh)
        self._pinned = np.zeros(len(rest.verts), bool) if pinned is None else pinned
        junctions = rest.junctions.without(self._pinned)
        self._follow = junctions.follow if len(junctions) else None
        self._labels = junctions.joined(rest.components) if len(junctions) else rest.components
        self._count = int(self._labels.max(initial=-1)) + 1
        held = np.bincount(self._labels[self._pinned], minlength=self._count) > 0
        free = ~self._pinned
        free[junctions.verts] = False
        free = _ungrounded(self._labels, free, held)
        self.rest, self._factor, matrix, self._divergence = _prepare(rest, np.flatnonzero(free), self._follow)
        self._divergence_t = self._divergence.T.tocsr()
        self._verts = rest.verts
        self._pull = matrix[:, self._pinned] @ self._verts[self._pinned] if held.any() else None
        if self._follow is not None:
            apart = self._verts - self._follow @ self._verts
            self._known = apart + self._follow @ np.where(self._pinned[:, None], self._verts, 0.0)
            self._pull = matrix @ self._known
        areas = self.rest.vertex_areas
        # In a component without area, all vertices have the same weight.
        share = np.where(self._sums(areas)[self._labels] > 0, areas, 1.0)
        share = np.where(held[self._labels], 0.0, share / self._sums(share)[self._labels])
        self._shares = share[:, None]
        self._rest_centres = self._sums(self._shares * rest.verts)

    def solve(self, jacobians: _Floats) -> _Floats:
        """Solve for the vertices whose gradients best fit the Jacobians; every component keeps its centre of mass.

        Parameters
        ----------
        jacobians : (F, 3, 3) float64
            ``edge_new = J @ edge_old``.

        Returns
        -------
        (V, 3) float64, object units. The same input gives the same bits.

        Raises
        ------
        ShapeError
            `jacobians` is not (F, 3, 3) float64.
        NumericalError
            The solution is not finite.
        """
        count = len(self.rest.faces)
        if jacobians.shape != (count, 3, 3) or jacobians.dtype != np.float64:
            raise ShapeError(f"expected jacobians ({count}, 3, 3) float64, got {jacobians.shape} {jacobians.dtype}")
        matrix, right = self._divergence, np.zeros((len(self._labels), 3))
        _diverge(matrix.indptr, matrix.indices, matrix.data, np.ascontiguousarray(jacobians), right)
        verts = self._solved(right if self._pull is None else right - self._pull)
        if self._follow is not None:
            verts += self._known
        if not np.isfinite(verts).all():
            raise NumericalError("The Jacobians are not finite, or too large to solve for.")
        verts += (self._rest_centres - self._sums(self._shares * verts))[self._labels]
        verts[self._pinned] = self._verts[self._pinned]
        return verts

    def solve_transposed(self, gradient: _Floats) -> _Floats:
        """Return the gradient (F, 3, 3) of the Jacobians for a gradient (V, 3) of the vertices."""
        matrix, field = self._divergence_t, np.zeros((len(self.rest.faces), 3, 3))
        solved = self._solved(self._balanced(gradient))
        _diverge_back(matrix.indptr, matrix.indices, matrix.data, solved, field)
        return field

    def smooth(self, forces: _Floats) -> _Floats:
        """Return the displacements (V, 3) that forces (V, 3) cause on a thin plate: G = S M S with S = L^-1.

        They are zero on pinned vertices, and do not move the centres of mass of components without any.
        """
        bent = self.rest.vertex_areas[:, None] * self._response(forces)
        return self._response(bent)

    def _response(self, forces: _Floats) -> _Floats:
        moved = self._solved(self._balanced(forces))
        moved -= self._sums(self._shares * moved)[self._labels]
        return moved

    def _solved(self, right: _Floats) -> _Floats:
        """Solve for vertices (V, 3), which follow edges where they lie on them; pinned ones are zero."""
        if self._follow is None:
            return self._factor.solve(right)
        return np.asarray(self._follow @ self._factor.solve(self._follow.T @ right))

    def _balanced(self, forces: _Floats) -> _Floats:
        """Remove the part that would move a component's centre of mass."""
        balanced: _Floats = forces - self._shares * self._sums(forces)[self._labels]
        return balanced

    def _sums(self, values: _Floats) -> _Floats:
        """Sum over each component, (V,) to (C,) or (V, 3) to (C, 3), always in the order of the vertices."""
        if values.ndim == 1:
            return np.bincount(self._labels, values, self._count).astype(np.float64)
        return np.stack([np.bincount(self._labels, column, self._count) for column in values.T], 1)


@kernel
def _diverge(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], data: _Floats, jacobians: _Floats, out: _Floats
) -> None:
    """Apply the right-hand side's operator, whose column 3 f + j is column j of each Jacobian (F, 3, 3)."""
    for v in range(len(out)):
        for k in range(indptr[v], indptr[v + 1]):
            f, j = divmod(indices[k], 3)
            for i in range(3):
                out[v, i] += data[k] * jacobians[f, i, j]


@kernel
def _diverge_back(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], data: _Floats, values: _Floats, out: _Floats
) -> None:
    """Apply the transposed operator to values (V, 3)."""
    for f in range(len(out)):
        for j in range(3):
            for k in range(indptr[3 * f + j], indptr[3 * f + j + 1]):
                for i in range(3):
                    out[f, i, j] += data[k] * values[indices[k], i]


def _ungrounded(labels: NDArray[np.int64], free: NDArray[np.bool_], held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return flags (V,) of the free vertices except the first of each component that is not held in place."""
    free = free.copy()
    candidates = np.flatnonzero(free)
    names, first = np.unique(labels[candidates], return_index=True)
    free[candidates[first[~held[names]]]] = False
    return free


def _prepare(
    rest: RestMesh, free: NDArray[np.int64], follow: sparse.csr_matrix | None
) -> tuple[RestMesh, Factor, sparse.csr_matrix, sparse.csr_matrix]:
    """Factor; return the mesh with the threshold used, factor, matrix, and the right-hand side's operator (V, 3F).

    `follow`, (V, V): takes the free vertices to all; None if all are free.
    """
    for shape in _SHAPES:
        rest_used = rest if shape == rest.collapsed_shape else RestMesh(rest.verts, rest.faces, shape)
        weighted = rest_used.gradient.T @ sparse.diags(np.repeat(rest_used.areas, 3))
        springs, stretch, weights = _springs(rest_used, np.flatnonzero(~rest_used.solid))
        pull = springs.T @ sparse.diags(weights)
        matrix = (weighted @ rest_used.gradient + pull @ springs).tocsr()
        reduced = matrix if follow is None else (follow.T @ matrix @ follow).tocsr()
        factor = factorise(reduced, free)
        if factor is not None:
            return rest_used, factor, matrix, (weighted + pull @ stretch).tocsr()
    raise NumericalError(
        "The mesh's Laplacian could not be factored.",
        advice="Remove needle-thin triangles (for example: merge vertices by distance), then try again.",
    )


def _springs(mesh: TriangleMesh, thin: NDArray[np.int64]) -> tuple[sparse.csr_matrix, sparse.csr_matrix, _Floats]:
    """Return the springs of the collapsed faces: differences (S, V), mapped edges (S, 3F) and weights (S,)."""
    verts, faces = mesh.verts, mesh.faces
    tail, head = faces[thin].ravel(), faces[thin][:, [1, 2, 0]].ravel()
    edges = verts[head] - verts[tail]
    lengths = np.linalg.norm(edges, axis=1).reshape(-1, 3)
    longest = lengths.max(1, keepdims=True, initial=0.0)
    longest[longest == 0] = 1.0
    weights = (_SPRING * longest / np.maximum(lengths, _SHORTEST * longest)).ravel()
    count = len(tail)
    row = np.arange(count)
    ends = np.concatenate([tail, head])
    signs = np.repeat([-1.0, 1.0], count)
    differences = sparse.csr_matrix((signs, (np.tile(row, 2), ends)), shape=(count, len(verts)))
    columns = (3 * np.repeat(thin, 3)[:, None] + np.arange(3)).ravel()
    stretch = sparse.csr_matrix((edges.ravel(), (np.repeat(row, 3), columns)), shape=(count, 3 * len(faces)))
    return differences, stretch, weights


def jacobians_from_verts(gradient_operator: sparse.csr_matrix, verts: _Floats) -> _Floats:
    """Compute the per-face Jacobians of the piecewise-linear map rest -> verts.

    Parameters
    ----------
    gradient_operator : sparse (3F, V) float64
        Gradient of the *rest* mesh, 1 / object unit.
    verts : (V, 3) float64
        Deformed positions, object units.

    Returns
    -------
    (F, 3, 3) float64, dimensionless: ``edge_new = J @ edge_old`` for the edges of each face. Along the rest normal,
    which the map does not determine, ``J @ n = 0``; `completed_jacobians` fills that direction. Of a collapsed face,
    only the longest edge is mapped.

    Raises
    ------
    ShapeError
        `verts` does not have one row for each column of the operator.
    """
    if verts.shape != (gradient_operator.shape[1], 3):
        raise ShapeError(f"expected verts ({gradient_operator.shape[1]}, 3), got {verts.shape}")
    return np.ascontiguousarray((gradient_operator @ verts).reshape(-1, 3, 3).transpose(0, 2, 1))


def completed_jacobians(mesh: TriangleMesh, verts: _Floats) -> _Floats:
    """Compute Jacobians (F, 3, 3) that also map the rest normal to the deformed one, stretched like the face.

    ``J = J_tangential + sqrt(area_new / area_old) * n_new n_old^T``: the thickness follows the in-plane scale, so a
    uniform scaling by s gives exactly ``s I`` and a rotation exactly the rotation. A face that is collapsed at rest
    gets the identity; one that has lost its area gets no normal part. `mesh`: at rest. Of a `RestMesh`, the operators
    are computed once however often this is called. `verts`, (V, 3) float64: deformed positions.
    """
    rest = RestMesh.of(mesh)
    tangential = jacobians_from_verts(rest.gradient, verts)
    solid = rest.areas > 0
    stretch = np.sqrt(face_areas(verts, rest.faces) / np.where(solid, rest.areas, 1.0))
    n_old, n_new = rest.normals, face_normals(verts, rest.faces)
    normal_part = (stretch[:, None] * n_new)[:, :, None] * n_old[:, None, :]
    return np.where(solid[:, None, None], tangential + normal_part, np.eye(3))
