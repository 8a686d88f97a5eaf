"""Find the shapes between a rest mesh and a result, and beyond it, by interpolating Jacobians.

With J = R S the Jacobian of a face from rest to result (R a rotation, S symmetric) and w = log R::

    J(t) = exp(t w) ((1 - t) I + t S)        v(t) = poisson(J(t))

so a limb that turns keeps its length on the way, which on straight lines of vertices it does not. w is chosen so that
neighbouring faces agree. For t > 1, an eigenvalue s < 1 of S becomes s^t, which never reaches zero.

The solve gives each component its shape, up to a translation. Components are placed by the bridges between them,
which turn and stretch in the same way, and the whole so that what both ends have in the same place
stays there. The ends are exact: t = 0 is the rest mesh and t = 1 the result, bit for bit.

Sources: Sumner et al. 2005, Mesh-Based Inverse Kinematics (rotations interpolated by their logarithms, the rest
linearly); Xu et al. 2006, Poisson Shape Interpolation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.deformation.bridges import Bridges, ComponentShifts
from meshdeform.deformation.jacobians import completed_jacobians, jacobians_from_verts
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.deformation.rotation_vectors import rotation_matrices, rotation_vectors
from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh

_STILL = 0.05
"""Displacement, relative to the diagonal, from which vertices hardly count as staying in place."""

_BETWEEN_COMPONENTS = 2.0

_MOST_AROUND = 100
"""Faces around a vertex of which all pairs are listed."""

_Floats = NDArray[np.float64]
_Flags = NDArray[np.bool_]
_Index = NDArray[np.int64]


class ShapePath:
    """The way from a mesh at rest to a result. The system is factored once, and each shape costs one solve.

    Parameters
    ----------
    mesh : TriangleMesh
        At rest.
    result : (V, 3) float64
        Vertices of the result, object units.

    Raises
    ------
    ShapeError
        The result has another number of vertices.
    NumericalError
        The system cannot be factored.
    """

    def __init__(self, mesh: TriangleMesh, result: _Floats) -> None:
        if result.shape != mesh.verts.shape:
            raise ShapeError(f"expected verts {mesh.verts.shape}, got {result.shape}")
        self._poisson = PoissonSystem(mesh)
        self._rest = rest = self._poisson.rest
        self._result = result.astype(np.float64)
        self._bridges = Bridges.of(rest)
        self._placement = ComponentShifts(self._bridges, int(rest.joined.max()) + 1)
        self._used = np.bincount(rest.faces.ravel(), minlength=len(rest.verts)) > 0
        self._labels = rest.joined
        jacobians = _jacobians(rest, self._result)
        self._vectors = rotation_vectors(jacobians, rest.solid, self._pairs())
        self._stretch = rotation_matrices(self._vectors).transpose(0, 2, 1) @ jacobians
        sides = self._bridges.faces
        self._turns = self._vectors[sides].mean(1) if len(sides) else np.empty((0, 3))
        ends = [self._bridges.lines(verts) for verts in (rest.verts, self._result)]
        self._lines = ends[0], _turned(-self._turns, ends[1])
        self._stillness = self._weights()
        self._missing = self._result - self._solved(1.0)

    def at(self, share: float) -> _Floats:
        """Return the vertices (V, 3) float64 at a share of the way: 0 is at rest, 1 the result, more exaggerates."""
        if share == 0:
            return self._rest.verts.copy()
        if share == 1:
            return self._result.copy()
        return np.asarray(self._solved(share) + share * self._missing)

    def _solved(self, share: float) -> _Floats:
        jacobians = rotation_matrices(share * self._vectors) @ _stretched(self._stretch, share)
        verts = self._poisson.solve(jacobians)
        begin, end = self._lines
        goal = _turned(share * self._turns, (1 - share) * begin + share * end)
        verts = verts + self._placement.translations(goal - self._bridges.lines(verts))[self._labels]
        groups = self._placement.groups[self._labels]
        straight = (1 - share) * self._rest.verts + share * self._result
        placed: _Floats = verts + _group_means(self._stillness, straight - verts, groups)[groups]
        return placed

    def _pairs(self) -> sparse.csr_matrix:
        """Return the pairs of faces that should agree: neighbours, and those that a bridge joins."""
        rest = self._rest
        neighbours = rest.edge_adjacency
        used = np.unique(rest.components[rest.faces[:, 0]])
        if sparse.csgraph.connected_components(neighbours, directed=False)[0] > len(used):
            neighbours = _around_vertices(rest)
        joined = _BETWEEN_COMPONENTS * self._bridges.pairs(len(rest.faces))
        return (sparse.triu(neighbours, 1) + joined).tocsr()

    def _weights(self) -> _Floats:
        """Return the weights (V,) of vertices, larger for those that the two ends have in the same place."""
        rest = self._rest.verts
        moved = np.linalg.norm(self._result - rest, axis=1)
        still = _STILL * float(np.linalg.norm(np.ptp(rest, axis=0)))
        areas = self._rest.vertex_areas
        areas = np.where(areas > 0, areas, 1e-9 * max(float(areas.max()), np.finfo(float).tiny))
        weights: _Floats = areas / (moved**2 + max(still**2, np.finfo(float).tiny))
        return weights


def _around_vertices(rest: RestMesh) -> sparse.csr_matrix:
    """Return the pairs of faces that share a vertex; around one of very many faces, each with the next one only."""
    incidence = rest.incidence
    crowded = np.bincount(rest.faces.ravel(), minlength=incidence.shape[1]) > _MOST_AROUND
    few = incidence[:, np.flatnonzero(~crowded)]
    vertex, face = incidence[:, np.flatnonzero(crowded)].T.nonzero()
    chained = vertex[1:] == vertex[:-1]
    chain = sparse.csr_matrix((chained.astype(np.float64), (face[:-1], face[1:])), shape=(incidence.shape[0],) * 2)
    return (few @ few.T + chain + chain.T > 0).astype(np.float64)


def _jacobians(rest: RestMesh, result: _Floats) -> _Floats:
    """Return the Jacobians of the faces; those of collapsed faces map only their longest edges."""
    solid = rest.solid[:, None, None]
    completed = completed_jacobians(rest, result)
    return np.where(solid, completed, jacobians_from_verts(rest.gradient, result))


def _stretched(stretch: _Floats, share: float) -> _Floats:
    """Return (1 - t) I + t S, with a geometric continuation of what shrinks beyond the result."""
    straight = (1 - share) * np.eye(3) + share * stretch
    if share <= 1:
        return straight
    symmetric = np.abs(stretch - stretch.transpose(0, 2, 1)).max((1, 2)) < 1e-6 * np.abs(stretch).max((1, 2))
    sizes, axes = np.linalg.eigh(stretch[symmetric])
    sizes = np.where(sizes < 1, np.maximum(sizes, 0.0) ** share, 1 + share * (sizes - 1))
    straight[symmetric] = (axes * sizes[:, None, :]) @ axes.transpose(0, 2, 1)
    return straight


def _turned(vectors: _Floats, lines: _Floats) -> _Floats:
    """Return lines (B, 3) rotated about the vectors (B, 3)."""
    return np.einsum("bij,bj->bi", rotation_matrices(vectors), lines) if len(lines) else lines


def _group_means(weights: _Floats, values: _Floats, groups: NDArray[np.int64]) -> _Floats:
    """Return the weighted means (G, 3) of values (V, 3) over groups of rows."""
    total = np.bincount(groups, weights)
    sums = [np.bincount(groups, weights * column) for column in values.T]
    return np.stack(sums, 1) / total[:, None]
