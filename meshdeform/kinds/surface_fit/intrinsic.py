"""Make a triangulation intrinsic Delaunay by flips: same surface, better triangles, vertices where they were.

An intrinsic triangulation is faces and edge lengths. An edge is Delaunay if the angles opposite to it sum to at most
pi, that is if cot a + cot b >= 0. A flip replaces an edge by the other diagonal of its two triangles, unfolded.

Source: Bobenko and Springborn 2007; Fisher et al. 2007, An Algorithm for the Construction of Intrinsic Delaunay
Triangulations with Applications to Digital Geometry Processing.

Laplacian, spectrum and geodesic distances of an intrinsic triangulation, from its edge lengths alone.

L is the positive semi-definite cotangent Laplacian, M the lumped mass: a third of the faces' areas at each vertex.
The spectrum solves L x = lambda M x. Distances are by the heat method:

    (M + t L) u = delta        X = -grad u / |grad u|        L phi = div X

The time t is the mean squared length of the edges over the area, not over the edges: where a base has most of its
triangles in small details, a mean over the edges is too short a time for the large triangles between them.

Source: Pinkall and Polthier 1993; Crane, Weischedel and Wardetzky 2013, Geodesics in Heat.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import eigsh, splu

from meshdeform.geometry.kernels import kernel
from meshdeform.kinds.surface_fit.gluing import glue

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class IntrinsicMesh:
    """Triangles of which only the side lengths are known."""

    faces: _Index  # (F, 3) int64: an edge may occur twice, or join a vertex with itself
    lengths: _Floats  # (F, 3) float64: side k runs from corner k to corner k + 1
    vertices: int
    flips: int  # number of flips that made it
    least: float  # smallest cot a + cot b of an inner edge: not below zero (but for rounding) if all are Delaunay

    @property
    def certified(self) -> bool:
        """Whether every inner edge is Delaunay."""
        return self.least >= -1e-6


def delaunay(verts: _Floats, faces: _Index) -> IntrinsicMesh:
    """Flip the edges of a manifold mesh until all are Delaunay.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
    """
    corners = verts[faces]
    lengths = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2)
    # Lengthen all sides alike where a triangle is so thin that rounding breaks its inequality (Sharp and Crane 2020).
    slack = lengths.sum(1, keepdims=True) - 2 * lengths
    lengths = lengths + max(0.0, float((1e-6 * np.median(lengths) - slack).max(initial=0.0)))
    faces, twin = faces.copy(), glue(verts, faces).ravel().copy()
    flat, sides = faces.reshape(-1), lengths.reshape(-1).copy()
    flips = int(_flip_all(flat, sides, twin))
    least = float(_sums(sides, twin).min(initial=np.inf))
    return IntrinsicMesh(flat.reshape(-1, 3), sides.reshape(-1, 3), len(verts), flips, least)


def half_cotangents(lengths: _Floats) -> _Floats:
    """Return half the cotangent (F, 3) of the angle opposite to each side."""
    squared = lengths**2
    area = areas_of(lengths)
    return np.asarray((squared.sum(1, keepdims=True) - 2 * squared) / (8 * area[:, None]))


def areas_of(lengths: _Floats) -> _Floats:
    """Return the areas (F,) of triangles by Kahan's form of Heron's formula."""
    c, b, a = np.sort(lengths, 1).T
    inside = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c))
    return np.asarray(0.25 * np.sqrt(np.maximum(inside, 1e-300)))


def _sums(sides: _Floats, twin: _Index) -> _Floats:
    """Return cot a + cot b of every inner edge."""
    cot = 2 * half_cotangents(sides.reshape(-1, 3)).ravel()
    inner = np.flatnonzero(twin > np.arange(len(twin)))
    return np.asarray(cot[inner] + cot[twin[inner]])


@kernel
def _cotangent(sides: _Floats, edge: int) -> float:
    """Return the cotangent of the angle opposite to a half-edge."""
    first = edge - edge % 3
    a, b, c = sides[edge], sides[first + (edge + 1) % 3], sides[first + (edge + 2) % 3]
    inside = (a + b + c) * (b + c - a) * (a + c - b) * (a + b - c)
    cotangent: float = (b * b + c * c - a * a) / math.sqrt(max(inside, 1e-300))
    return cotangent


@kernel
def _flip_all(faces: _Index, sides: _Floats, twin: _Index) -> int:
    """Flip until every inner edge is Delaunay; return the number of flips."""
    count = len(faces)
    queue, waiting = list(range(count)), np.ones(count, np.bool_)
    flips = 0
    while len(queue) > 0:
        e = queue.pop()
        waiting[e] = False
        t = twin[e]
        if t < 0 or e // 3 == t // 3 or _cotangent(sides, e) + _cotangent(sides, t) >= -_TOLERANCE:
            continue
        f, g = e - e % 3, t - t % 3
        e1, e2, t1, t2 = f + (e + 1) % 3, f + (e + 2) % 3, g + (t + 1) % 3, g + (t + 2) % 3
        # Unfold: the edge on the x axis from (0, 0), one tip above, one below.
        base, la, lb, lc, ld = sides[e], sides[e1], sides[e2], sides[t1], sides[t2]
        x1 = (base * base + lb * lb - la * la) / (2 * base)
        x2 = (base * base + lc * lc - ld * ld) / (2 * base)
        y1, y2 = math.sqrt(max(lb * lb - x1 * x1, 0.0)), math.sqrt(max(lc * lc - x2 * x2, 0.0))
        crossing = (x1 * y2 + x2 * y1) / max(y1 + y2, 1e-300)
        if crossing <= 0.0 or crossing >= base:
            continue  # rounding: the diagonals do not cross
        length = math.hypot(x1 - x2, y1 + y2)
        a, b, c, d = faces[e], faces[e1], faces[e2], faces[t2]
        n_a, n_b, n_c, n_d = twin[e1], twin[e2], twin[t1], twin[t2]
        # New faces: (c, d, b) in place of f, and (d, c, a) in place of g.
        faces[f], faces[f + 1], faces[f + 2] = c, d, b
        faces[g], faces[g + 1], faces[g + 2] = d, c, a
        sides[f], sides[f + 1], sides[f + 2] = length, ld, la
        sides[g], sides[g + 1], sides[g + 2] = length, lb, lc
        # Old half-edges to new ones; a neighbour may be one of them.
        n_a = _moved(n_a, e1, e2, t1, t2, f, g)
        n_b = _moved(n_b, e1, e2, t1, t2, f, g)
        n_c = _moved(n_c, e1, e2, t1, t2, f, g)
        n_d = _moved(n_d, e1, e2, t1, t2, f, g)
        twin[f], twin[g] = g, f
        twin[f + 1], twin[f + 2], twin[g + 1], twin[g + 2] = n_d, n_a, n_b, n_c
        for new in (f + 1, f + 2, g + 1, g + 2):
            if twin[new] >= 0:
                twin[twin[new]] = new
            if not waiting[new]:
                waiting[new] = True
                queue.append(new)
        flips += 1
    return flips


@kernel
def _moved(edge: int, e1: int, e2: int, t1: int, t2: int, f: int, g: int) -> int:
    """Return the new number of a half-edge of the two faces; others keep theirs."""
    if edge == e1:
        return f + 2
    if edge == e2:
        return g + 1
    if edge == t1:
        return g + 2
    if edge == t2:
        return f + 1
    return edge


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
    # Beside a large part, the shift of a small one is below what floats hold; a share of its own diagonal is not.
    shifted = matrix - shift * sparse.diags(masses) + 1e-12 * sparse.diags(matrix.diagonal())
    solve = splu(shifted.tocsc(), diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    inverse = sparse.linalg.LinearOperator(matrix.shape, solve.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(mesh.vertices)
    values, vectors = eigsh(
        matrix, count, M=sparse.diags(masses).tocsc(), sigma=shift, which="LM", OPinv=inverse, v0=start
    )
    order = np.argsort(values)
    return np.maximum(values[order], 0.0), vectors[:, order]


class HeatGeodesics:
    """Geodesic distances on a triangulation; the systems are factored once."""

    def __init__(self, mesh: IntrinsicMesh) -> None:
        self._mesh = mesh
        masses, matrix, areas = mass(mesh), laplacian(mesh), areas_of(mesh.lengths)
        count, self._parts = csgraph.connected_components(matrix, directed=False)
        # A time for each part: that of a large one would be forever on a small one.
        part = self._parts[mesh.faces[:, 0]]
        squares = np.bincount(part, areas * (mesh.lengths**2).mean(1), count)
        time = squares / np.maximum(np.bincount(part, areas, count), 1e-300)
        # Each part is held at a vertex: what is to be solved sums to zero on it, so the rest is exact.
        held = np.zeros(mesh.vertices)
        held[np.unique(self._parts, return_index=True)[1]] = 1.0
        heat = sparse.diags(masses) + sparse.diags(time[self._parts]) @ matrix
        grounded = matrix + sparse.diags(held * np.maximum(matrix.diagonal(), 1.0))
        options = {"SymmetricMode": True}
        self._heat, self._poisson = (splu(m.tocsc(), diag_pivot_thresh=0.0, options=options) for m in (heat, grounded))
        self._weights = half_cotangents(mesh.lengths)

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
