"""Laplacian, spectrum and geodesic distances of an intrinsic triangulation, from its edge lengths alone.

L is the positive semi-definite cotangent Laplacian, M the lumped mass: a third of the faces' areas at each vertex.
The spectrum solves L x = lambda M x. Distances are by the heat method:

    (M + t L) u = delta        X = -grad u / |grad u|        L phi = div X

The time t is the mean squared length of the edges over the area, not over the edges: where a base has most of its
triangles in small details, a mean over the edges is too short a time for the large triangles between them.

Source: Pinkall and Polthier 1993; Crane, Weischedel and Wardetzky 2013, Geodesics in Heat.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import eigsh, splu

from meshdeform.fields.intrinsic import IntrinsicMesh, areas_of, half_cotangents

_Floats = NDArray[np.float64]


def laplacian(mesh: IntrinsicMesh) -> sparse.csc_matrix:
    """Return L (V, V); positive semi-definite, rows sum to zero."""
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, 1).ravel()
    weights = half_cotangents(mesh.lengths).ravel()
    rows, columns = np.concatenate([start, end, start, end]), np.concatenate([end, start, start, end])
    values = np.concatenate([-weights, -weights, weights, weights])
    return sparse.csc_matrix((values, (rows, columns)), shape=(mesh.vertices, mesh.vertices))


def mass(mesh: IntrinsicMesh) -> _Floats:
    """Return the lumped mass (V,) in squared units."""
    parts = np.repeat(areas_of(mesh.lengths) / 3, 3)
    return np.bincount(mesh.faces.ravel(), parts, mesh.vertices).astype(np.float64)


def spectrum(mesh: IntrinsicMesh, count: int) -> tuple[_Floats, _Floats]:
    """Return the smallest `count` eigenvalues, ascending, and eigenfunctions (V, count), orthonormal under M."""
    masses = np.maximum(mass(mesh), 1e-300)
    matrix, count = laplacian(mesh), min(count, mesh.vertices - 2)
    # Shifted a little below zero, where L is singular.
    shift = -1e-2 / masses.sum()
    solve = splu(
        (matrix - shift * sparse.diags(masses)).tocsc(), diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    inverse = sparse.linalg.LinearOperator(matrix.shape, solve.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(mesh.vertices)
    values, vectors = eigsh(
        matrix, count, M=sparse.diags(masses).tocsc(), sigma=shift, which="LM", OPinv=inverse, v0=start
    )
    order = np.argsort(values)
    return np.maximum(values[order], 0.0), vectors[:, order]


class HeatGeodesics:
    """Geodesic distances on a triangulation; the systems are factored once.

    Parameters
    ----------
    factor : float
        The time t is this times the mean squared edge length over the area.
    """

    def __init__(self, mesh: IntrinsicMesh, factor: float = 1.0) -> None:
        self._mesh = mesh
        masses, matrix = mass(mesh), laplacian(mesh)
        time = factor * float(np.average((mesh.lengths**2).mean(1), weights=areas_of(mesh.lengths)))
        options = {"SymmetricMode": True}
        self._heat = splu((sparse.diags(masses) + time * matrix).tocsc(), diag_pivot_thresh=0.0, options=options)
        shift = 1e-10 / max(float(masses.sum()), 1e-300)
        self._poisson = splu((matrix + shift * sparse.diags(masses)).tocsc(), diag_pivot_thresh=0.0, options=options)
        self._weights = half_cotangents(mesh.lengths)
        _, self._parts = csgraph.connected_components(matrix, directed=False)

    def distances(self, sources: Sequence[int]) -> _Floats:
        """Return distances (V,) from the nearest of some vertices; infinite on parts without one."""
        mesh = self._mesh
        delta = np.zeros(mesh.vertices)
        delta[list(sources)] = 1.0
        heat = np.maximum(self._heat.solve(delta), 0.0)
        # Far away heat is below what floats hold beside 1; a scale per face does not change a direction.
        u = heat[mesh.faces]
        u = u / np.maximum(u.max(1, keepdims=True), 1e-300)
        x, y = self._layout()
        # The gradient in the plane of the face: 2 area grad u = sum of u_k times the opposite side, turned.
        ex, ey = np.roll(x, -2, 1) - np.roll(x, -1, 1), np.roll(y, -2, 1) - np.roll(y, -1, 1)
        gx, gy = -(u * ey).sum(1), (u * ex).sum(1)
        size = np.maximum(np.hypot(gx, gy), 1e-300)
        fx, fy = -gx / size, -gy / size
        # Divergence at corner k: half the sum of cot times side dot field, over the two sides at the corner.
        sx, sy = np.roll(x, -1, 1) - x, np.roll(y, -1, 1) - y
        along = self._weights * (sx * fx[:, None] + sy * fy[:, None])
        divergence = np.bincount(mesh.faces.ravel(), (along - np.roll(along, 1, 1)).ravel(), mesh.vertices)
        phi = self._poisson.solve(-divergence)
        out = np.full(mesh.vertices, np.inf)
        for part in np.unique(self._parts[list(sources)]):
            inside = self._parts == part
            chosen = [s for s in sources if self._parts[s] == part]
            out[inside] = phi[inside] - float(phi[chosen].mean())
        return np.asarray(np.maximum(out, 0.0))

    def _layout(self) -> tuple[_Floats, _Floats]:
        """Return the corners of each face in a plane of its own: x and y (F, 3)."""
        a, b, c = self._mesh.lengths.T
        x = (a**2 + c**2 - b**2) / (2 * a)
        y = 2 * areas_of(self._mesh.lengths) / a
        zero = np.zeros_like(a)
        return np.stack([zero, a, x], 1), np.stack([zero, zero, y], 1)
