"""Find the points of a mesh that are nearest to others, and interpolate there.

A k-d tree of samples, with their normals as further coordinates, gives a first triangle; from there the search walks to
nearer ones around it.

Source: Ericson 2005, Real-Time Collision Detection, section 5.1.5 (the nearest point of a triangle).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from meshdeform.geometry.copies import first_alike
from meshdeform.geometry.folds import area_vectors
from meshdeform.geometry.kernels import Worth, kernel
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.surface_samples import count_samples, samples_of
from meshdeform.geometry.walks import walked

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_OPPOSITE = 2.0
"""Distance, in typical edges, that counts as much as opposite normals: the other side of a thin wall is not near."""

_CHUNK = 100_000
_MOST_MOVES = 50

_MOST_AROUND = 1_000
"""Faces around a vertex to which the search walks."""

_SAMPLES, _SAMPLES_OF_FACE = 2_000_000, 6
"""Samples that a tree may have, and more for each face."""

_CELLS_OF_SPACING, _COPIES = 64, 32
"""How small a cell is in which samples count as one, and how many must share one on average: no single surface has as
many around a vertex."""
_compiles = Worth(50_000)
"""Whether numba walks for so many points: those of two reports' worth take numpy as long as its import."""


def blend_matrix(corners: _Index, weights: _Floats, count: int) -> sparse.csr_matrix:
    """Return the matrix (P, V) that interpolates values of `count` vertices at points of faces.

    `corners` is (P, 3) int64; `weights`, (P, 3) float64: barycentric coordinates.
    """
    rows = np.arange(len(corners) + 1) * 3
    return sparse.csr_matrix((weights.ravel(), corners.ravel(), rows), shape=(len(corners), count))


class SurfaceTree:
    """A search tree of the surface of a mesh.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
    normals : (F, 3) float64
        Unit normals of the faces.
    spacing : float
        Greatest distance between neighbouring samples; where large faces lie on each other, it is made greater.
    opposite : float
        Distance that counts as much as opposite normals.
    slack : float
        How much farther than the nearest sample the one may be from which the walk begins, as a share; more is faster.
    """

    def __init__(
        self, verts: _Floats, faces: _Index, normals: _Floats, *, spacing: float, opposite: float, slack: float = 0.0
    ) -> None:
        self._verts, self._faces, self._turn, self._slack = verts, faces, opposite / 2, slack
        while count_samples(verts, faces, spacing) > _SAMPLES + _SAMPLES_OF_FACE * len(faces):
            spacing *= 1.5
        once = first_alike(faces)  # copies of a face are as near as the first
        samples, owner = samples_of(verts, faces[once], spacing)
        points = np.concatenate([samples, self._turn * normals[once[owner]]], 1)
        apart = _apart(points, spacing / _CELLS_OF_SPACING)
        self._owner, self._tree = once[owner[apart]], cKDTree(points[apart])
        around, self._begin = _faces_around(faces[once], len(verts))
        self._around = once[around]

    @classmethod
    def of(cls, verts: _Floats, faces: _Index, slack: float = 0.0) -> SurfaceTree:
        """Return the tree of a mesh with samples as far apart as its edges are long, for walls thicker than those."""
        cross = area_vectors(verts, faces)
        twice = np.linalg.norm(cross, axis=1)
        edge = max(math.sqrt(twice.sum() / len(faces)), 1e-150)
        normals = cross / np.maximum(twice, 1e-300)[:, None]
        return cls(verts, faces, normals, spacing=edge, opposite=_OPPOSITE * edge, slack=slack)

    def find(self, points: _Floats, normals: _Floats) -> tuple[_Index, _Floats]:
        """Return the nearest face (P,) of each point and the barycentric coordinates (P, 3) of the nearest point.

        Parameters
        ----------
        points, normals : (P, 3) float64
            Normals are unit normals of the surface to which the points belong; zero if unknown.
        """
        nearest, weights = np.empty(len(points), np.int64), np.empty((len(points), 3))
        for start in range(0, len(points), _CHUNK):
            rows = slice(start, start + _CHUNK)
            queries = np.concatenate([points[rows], self._turn * normals[rows]], 1)
            nearest[rows] = self._owner[self._tree.query(queries, eps=self._slack)[1]]
            surface = self._verts, self._faces, self._around, self._begin
            if _compiles(len(points)):
                _descend(points[rows], nearest[rows], *surface, weights[rows])
            else:
                nearest[rows], weights[rows] = walked(
                    points[rows], nearest[rows], *surface, most_moves=_MOST_MOVES, most_around=_MOST_AROUND
                )
        return nearest, weights


class NearestPoints:
    """The points of a mesh at rest that are nearest to others.

    Parameters
    ----------
    points : (P, 3) float64
        Near the mesh.
    normals : (P, 3) float64
        Unit normals of the surface to which the points belong; zero if unknown.

    Attributes
    ----------
    faces : (P,) int64
        The nearest face of each point.
    corners : (P, 3) int32
        Its corners.
    weights : (P, 3) float64
        Barycentric coordinates of the nearest point.
    """

    def __init__(self, mesh: RestMesh, points: _Floats, normals: _Floats, *, tree: SurfaceTree | None = None) -> None:
        self._verts, faces = mesh.verts, mesh.faces
        tree = tree_of(mesh, known=bool(normals.any())) if tree is None else tree
        self.faces, self.weights = tree.find(points, normals)
        self.corners = faces[self.faces].astype(np.int32)

    @classmethod
    def of_mirrored(cls, mesh: RestMesh, points: _Floats, axes: Sequence[int]) -> Iterator[tuple[_Floats, Self]]:
        """Yield the mirror images (P, 3) of points along each axis, in the mesh's box, and the points near them."""
        tree, (low, high) = tree_of(mesh, known=False), mesh.box
        for axis in axes:
            mirrored = points.copy()
            mirrored[:, axis] = low[axis] + high[axis] - points[:, axis]
            yield mirrored, cls(mesh, mirrored, np.zeros_like(mirrored), tree=tree)

    def distances(self, points: _Floats) -> _Floats:
        """Return the distances (P,) of the points from the mesh."""
        return np.asarray(np.linalg.norm(points - self.blend(self._verts), axis=1))

    def blend(self, values: _Floats) -> _Floats:
        """Interpolate values (V, K) of the vertices there, (P, K)."""
        out = np.zeros((len(self.corners), values.shape[1]))
        for k in range(3):
            out += self.weights[:, k, None] * values[self.corners[:, k]]
        return out


def _apart(points: _Floats, distance: float) -> _Index | slice:
    """Return the first of all points (P, 6) in each cell of a grid, if very many share one; else all.

    A search looks at all that are equally near: of thousands of copies in one position, one shows the way.
    """
    first = first_alike(np.floor(points / distance).astype(np.int64))
    return first if len(first) * _COPIES < len(points) else slice(None)


def tree_of(mesh: RestMesh, *, known: bool) -> SurfaceTree:
    """Return the tree to search with normals that are known, or with zeros."""
    edge = math.sqrt(2 * float(mesh.areas.sum()) / len(mesh.faces))
    # Unknown normals are equally far from all, which would only keep the tree from leaving branches out.
    opposite = _OPPOSITE * edge if known else 0.0
    return SurfaceTree(mesh.verts, mesh.faces, mesh.normals, spacing=edge, opposite=opposite)


def _faces_around(faces: _Index, count: int) -> tuple[_Index, _Index]:
    """Return the faces around all vertices, in the order of the vertices, and where those of each begin, (V + 1,)."""
    corners = faces.ravel()
    begin = np.concatenate([[0], np.bincount(corners, minlength=count).cumsum()])
    return np.argsort(corners, kind="stable") // 3, begin


@kernel
def _quotient(share: float, total: float) -> float:
    return share / total if total != 0.0 else 0.0


@kernel
def nearest_on_triangle(p: _Floats, a: _Floats, b: _Floats, c: _Floats, weights: _Floats) -> float:
    """Set the barycentric coordinates of the nearest point of a triangle; return the squared distance."""
    # Written out: temporary arrays would take ten times as long.
    ab0, ab1, ab2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ac0, ac1, ac2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    ap0, ap1, ap2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    bp0, bp1, bp2 = p[0] - b[0], p[1] - b[1], p[2] - b[2]
    cp0, cp1, cp2 = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    d1, d2 = ab0 * ap0 + ab1 * ap1 + ab2 * ap2, ac0 * ap0 + ac1 * ap1 + ac2 * ap2
    d3, d4 = ab0 * bp0 + ab1 * bp1 + ab2 * bp2, ac0 * bp0 + ac1 * bp1 + ac2 * bp2
    d5, d6 = ab0 * cp0 + ab1 * cp1 + ab2 * cp2, ac0 * cp0 + ac1 * cp1 + ac2 * cp2
    v, w = 0.0, 0.0
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = _quotient(d1, d1 - d3)
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = _quotient(d2, d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = _quotient(d4 - d3, (d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = _quotient(vb, va + vb + vc), _quotient(vc, va + vb + vc)
    weights[0], weights[1], weights[2] = 1.0 - v - w, v, w
    x, y, z = ap0 - v * ab0 - w * ac0, ap1 - v * ab1 - w * ac1, ap2 - v * ab2 - w * ac2
    return float(x * x + y * y + z * z)


@kernel
def _descend(
    points: _Floats, faces_found: _Index, verts: _Floats, faces: _Index, around: _Index, begin: _Index, weights: _Floats
) -> None:
    """Walk from a face to the nearest one around it as long as that is nearer; set it and the coordinates."""
    nearest = np.empty(3)
    for number in range(len(points)):
        p, face = points[number], faces_found[number]
        best = nearest_on_triangle(
            p, verts[faces[face, 0]], verts[faces[face, 1]], verts[faces[face, 2]], weights[number]
        )
        for _ in range(_MOST_MOVES):
            here = face
            for k in range(3):
                corner = faces[here, k]
                for at in range(begin[corner], min(begin[corner + 1], begin[corner] + _MOST_AROUND)):
                    other = around[at]
                    squared = nearest_on_triangle(
                        p, verts[faces[other, 0]], verts[faces[other, 1]], verts[faces[other, 2]], nearest
                    )
                    if squared < best:
                        best, face = squared, other
                        # One by one: to assign a row, numba compiles the text of an error for seconds.
                        for i in range(3):
                            weights[number, i] = nearest[i]
            if face == here:
                break
        faces_found[number] = face
