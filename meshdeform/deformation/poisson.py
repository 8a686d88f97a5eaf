"""Solve the Poisson equation for vertices with given per-face Jacobians, differentiably.

    min_v  sum_f |f| ||grad_f(v) - J_f||^2     <=>     L v = G^T M J,   L = G^T M G

The matrix is factored once per mesh. The kernel of L consists of the functions that are constant on each connected
component, so one vertex per component is grounded for the factorisation; the component is then moved to its centre of
mass at rest. The matrix is symmetric, so the backward pass reuses the same factor. Sources: Xu et al. 2024,
FusionDeformer, eq. 6; Aigerman et al. 2022, Neural Jacobian Fields, eq. 4.

Pinned vertices are eliminated: their rows leave the matrix, and their positions at rest go to the right-hand side. What
remains is positive definite on a component with a pinned vertex, so none is grounded there, and the component is not
moved to its centre of mass: the pinned vertices determine its place.

Collapsed faces (`collapse.COLLAPSED_SHAPE`) have no weight, because their cotangents would swamp all others in
float64. To keep what they connect together, each of their edges e is a weak spring  w ||v_j - v_i - J_f e||^2,
w = 1e-6 longest edge / |e|, dimensionless like the cotangents. Springs have zero energy under every deformation with
consistent Jacobians, and a vertex on the long edge of a collapsed face follows that edge linearly. If the factorisation
still fails, the threshold for collapsed faces is raised to 30 and then to 1,000 times its value.

QDLDL (Apache-2.0) computes the factor; the triangular solves are our own, for all three coordinates at once.
`bench/poisson.py` compares them with SuperLU.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.deformation.linear_system import Factor, factorise, solve_linear
from meshdeform.errors import NumericalError, ShapeError
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.rest_mesh import COLLAPSED_SHAPE, RestMesh

__all__ = ["PoissonSystem"]

_SHAPES = (COLLAPSED_SHAPE, 30 * COLLAPSED_SHAPE, 1000 * COLLAPSED_SHAPE)
_SPRING = 1e-6
_SHORTEST = 1e-3
"""Lower bound of an edge length of a collapsed face, relative to its longest edge."""

_Floats = NDArray[np.float64]


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
        self._labels, self._count = rest.components.numpy(), rest.num_components
        self._pinned = np.zeros(len(self._labels), bool) if pinned is None else pinned
        held = np.bincount(self._labels[self._pinned], minlength=self._count) > 0
        free = _ungrounded(self._labels, held) & ~self._pinned
        self.rest, self._factor, matrix, self._divergence = _prepare(rest, np.flatnonzero(free))
        self._divergence_t = self._divergence.T.tocsr()
        self._verts = rest.verts.numpy()
        self._pull = matrix[:, self._pinned] @ self._verts[self._pinned] if held.any() else None
        areas = self.rest.vertex_areas
        # In a component without area, all vertices have the same weight.
        share = np.where(self._sums(areas)[self._labels] > 0, areas, 1.0)
        share = np.where(held[self._labels], 0.0, share / self._sums(share)[self._labels])
        self._shares = share[:, None]
        self._rest_centres = self._sums(self._shares * rest.verts.numpy())

    def solve(self, jacobians: Tensor, known: Tensor | None = None) -> Tensor:
        """Solve for the vertices whose gradients best fit the Jacobians; every component keeps its centre of mass.

        Parameters
        ----------
        jacobians : (F, 3, 3) float64
            ``edge_new = J @ edge_old``.
        known : (V, 3) float64, optional
            The solution, if it has already been computed for these Jacobians; then only the gradient is computed.

        Returns
        -------
        (V, 3) float64, object units. Differentiable once in `jacobians`. The same input gives the same bits.

        Raises
        ------
        ShapeError
            `jacobians` is not (F, 3, 3) float64.
        NumericalError
            The solution is not finite.
        """
        if jacobians.shape != (self.rest.faces.shape[0], 3, 3) or jacobians.dtype != torch.float64:
            raise ShapeError(
                f"expected jacobians ({self.rest.faces.shape[0]}, 3, 3) float64, "
                f"got {tuple(jacobians.shape)} {jacobians.dtype}"
            )
        return solve_linear(self, jacobians, known)

    def _forward(self, jacobians: _Floats) -> _Floats:
        matrix, right = self._divergence, np.zeros((len(self._labels), 3))
        _diverge(matrix.indptr, matrix.indices, matrix.data, np.ascontiguousarray(jacobians), right)
        verts: _Floats = self._factor.solve(right if self._pull is None else right - self._pull)
        if not np.isfinite(verts).all():
            raise NumericalError("The Jacobians are not finite, or too large to solve for.")
        verts += (self._rest_centres - self._sums(self._shares * verts))[self._labels]
        verts[self._pinned] = self._verts[self._pinned]
        return verts

    def _backward(self, gradient: _Floats) -> _Floats:
        matrix, field = self._divergence_t, np.zeros((len(self.rest.faces), 3, 3))
        solved = self._factor.solve(self._balanced(gradient))
        _diverge_back(matrix.indptr, matrix.indices, matrix.data, solved, field)
        return field

    def smooth(self, forces: _Floats) -> _Floats:
        """Return the displacements (V, 3) that forces (V, 3) cause on a thin plate: G = S M S with S = L^-1.

        They are zero on pinned vertices, and do not move the centres of mass of components without any.
        """
        bent = self.rest.vertex_areas[:, None] * self._response(forces)
        return self._response(bent)

    def _response(self, forces: _Floats) -> _Floats:
        moved: _Floats = self._factor.solve(self._balanced(forces))
        moved -= self._sums(self._shares * moved)[self._labels]
        return moved

    def _balanced(self, forces: _Floats) -> _Floats:
        """Remove what would move a component's centre of mass."""
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


def _ungrounded(labels: NDArray[np.int64], held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return flags (V,) of all vertices except the first of each component that is not held in place."""
    _, first = np.unique(labels, return_index=True)
    free = np.ones(len(labels), bool)
    free[first[~held]] = False
    return free


def _prepare(rest: RestMesh, free: NDArray[np.int64]) -> tuple[RestMesh, Factor, sparse.csr_matrix, sparse.csr_matrix]:
    """Factor; return the mesh with the threshold used, factor, matrix, and the right-hand side's operator (V, 3F)."""
    for shape in _SHAPES:
        taken = rest if shape == rest.collapsed_shape else RestMesh(rest.verts, rest.faces, shape)
        weighted = taken.gradient.T @ sparse.diags(np.repeat(taken.areas, 3))
        springs, stretch, weights = _springs(taken, np.flatnonzero(~taken.solid))
        pull = springs.T @ sparse.diags(weights)
        matrix = (weighted @ taken.gradient + pull @ springs).tocsr()
        factor = factorise(matrix, free)
        if factor is not None:
            return taken, factor, matrix, (weighted + pull @ stretch).tocsr()
    raise NumericalError(
        "The mesh's Laplacian could not be factored.",
        advice="Remove needle-thin triangles (for example: merge vertices by distance), then try again.",
    )


def _springs(mesh: TriangleMesh, thin: NDArray[np.int64]) -> tuple[sparse.csr_matrix, sparse.csr_matrix, _Floats]:
    """Return the springs of the collapsed faces: differences (S, V), mapped edges (S, 3F) and weights (S,)."""
    verts, faces = mesh.verts.numpy(), mesh.faces.numpy()
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
