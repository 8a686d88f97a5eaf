"""Move the vertices of a mesh with a simplified one, of which the deformation is given.

Every vertex p is bound to the nearest point on the simplified mesh at rest, among those that face the same way. With
b_i the barycentric coordinates of that point, d_i the displacements of its corners x_i and A_i the area-weighted mean
of the completed Jacobians around each corner, the vertex follows the affine map ::

    p' = p + sum_i b_i (d_i + (A_i - I) (p - x_i))

The nearest point jumps where the simplified mesh has a valley, so these maps are then averaged with those of the
vertices around, a few times. They predict the same positions where the deformation is a similarity, so averaging keeps
it exact; and where nothing moves, the vertices keep their bits.

A Poisson solve of the whole mesh with the A_i as its Jacobians was no more accurate: under a smooth bend of a sphere
of 120,000 faces, the 99th percentile of the normals' errors was 15 degrees, against 14 here, and a million faces took
59 s of CPU time and 2.7 GB to factor. Without averaging, 27 faces of a million folded; with it, none.

Source: Sumner et al. 2007, Embedded Deformation for Shape Manipulation, eq. 1 (blended affine maps).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.deformation.jacobians import jacobians_from_verts
from meshdeform.geometry.mesh import RestMesh, TriangleMesh, face_areas, face_cross, face_normals
from meshdeform.geometry.nearest_points import NearestPoints

_FACES_PER_ROUND = 8
"""Faces per simplified face for each round of averaging. Fewer leave kinks, more blur the deformation."""
_ROUNDS = (2, 32)
_Floats = NDArray[np.float64]


class Binding:
    """Binding of the vertices of a mesh to a simplified one.

    `closely`: average only where the whole mesh is much finer: closer to the deformation, and less smooth.
    """

    def __init__(self, simple: RestMesh, whole: RestMesh, *, closely: bool = False) -> None:
        self._simple, self._points = simple, whole.verts
        self._places = NearestPoints(simple, self._points, corner_normals(whole))
        self._average = _average_around(whole)
        ratio = whole.faces.shape[0] / simple.faces.shape[0]
        self._rounds = min(max(math.ceil(ratio / _FACES_PER_ROUND), _ROUNDS[0]), _ROUNDS[1])
        if closely:
            self._rounds = min(int(ratio / _FACES_PER_ROUND), _ROUNDS[1])

    def move(self, verts: _Floats) -> _Floats:
        """Return the vertices of the whole mesh for deformed vertices (V, 3) float64 of the simple one."""
        linear = self._corner_maps(verts)
        rest = self._simple.verts
        constant = verts - rest - np.einsum("vij,vj->vi", linear, rest)
        maps = self._places.blend(np.concatenate([linear.reshape(-1, 9), constant], 1))
        for _ in range(self._rounds):
            maps = self._average @ maps
        turned = np.einsum("pij,pj->pi", maps[:, :9].reshape(-1, 3, 3), self._points)
        return np.asarray(self._points + (turned + maps[:, 9:]))

    def _corner_maps(self, verts: _Floats) -> _Floats:
        """Return A_i - I (V, 3, 3): the mean over the faces around each corner, exactly zero where none moves."""
        rest = self._simple
        areas = rest.areas
        divisor = np.where(areas > 0, areas, 1.0)
        stretch, unit = (np.sqrt(face_areas(v, rest.faces) / divisor)[:, None] for v in (verts, rest.verts))
        along = stretch * face_normals(verts, rest.faces) - unit * rest.normals
        change = jacobians_from_verts(rest.gradient, verts - rest.verts) + along[:, :, None] * rest.normals[:, None]
        total = rest.incidence.T @ (change * areas[:, None, None]).reshape(-1, 9)
        return np.asarray(total / np.maximum(3 * rest.vertex_areas, 1e-300)[:, None]).reshape(-1, 3, 3)


def corner_normals(mesh: TriangleMesh) -> _Floats:
    """Return the area-weighted unit normals (V, 3) of the vertices; zero where they cancel."""
    cross, corners = face_cross(mesh.verts, mesh.faces), mesh.faces
    count = mesh.verts.shape[0]
    total = np.zeros((count, 3))
    for axis in range(3):
        for k in range(3):
            total[:, axis] += np.bincount(corners[:, k], cross[:, axis], count)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(np.divide(total, length, out=np.zeros_like(total), where=length > 0))


def _average_around(mesh: RestMesh) -> sparse.csr_matrix:
    """Return the matrix (V, V) that averages values with those of the vertices around."""
    corners, count = mesh.faces.astype(np.int32), mesh.verts.shape[0]
    tails, heads = corners.ravel(), corners[:, [1, 2, 0]].ravel()
    rows, columns = np.concatenate([tails, heads]), np.concatenate([heads, tails])
    around = sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)) + sparse.identity(count)
    return (sparse.diags(1 / np.asarray(around.sum(1)).ravel()) @ around).tocsr()
