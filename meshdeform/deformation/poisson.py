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
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.deformation.factor import Factor, factorise
from meshdeform.errors import NumericalError, ShapeError
from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import RestMesh, TriangleMesh

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


_SHAPES = (COLLAPSED_SHAPE, 30 * COLLAPSED_SHAPE, 1000 * COLLAPSED_SHAPE)
_SPRING = 1e-6

_SHORTEST = 1e-3
"""Lower bound of an edge length of a collapsed face, relative to its longest edge."""


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
