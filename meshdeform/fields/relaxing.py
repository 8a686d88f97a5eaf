"""Move the vertices of a mesh along its surface, so that slivers become triangles that can be collapsed.

An extracted mesh has slivers wherever the surface passes close to a point of the grid. Collapsing an edge of a sliver
would turn a face over, so a decimation leaves whole regions as dense as they are and takes all it must from the rest:
of a thin torus it made edges twenty times as long as the tube is thick.

Source: Field 1988, Laplacian Smoothing and Delaunay Triangulations; here each vertex is projected back to the surface.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.fields.cleaning import CleanMesh

_Floats = NDArray[np.float64]
_TIMES = 3


def relaxed(mesh: CleanMesh, project: Callable[[_Floats, _Floats], tuple[_Floats, _Floats]]) -> CleanMesh:
    """Return the mesh with each vertex amid its neighbours, on the surface; those of borders stay.

    Parameters
    ----------
    project : callable
        From points (P, 3) and unit normals (P, 3) to places on the surface and normals there.
    """
    verts, faces = mesh.verts, mesh.faces
    start, end = faces.ravel(), np.roll(faces, -1, 1).ravel()
    ones = np.ones(len(start))
    near = sparse.csr_matrix((ones, (start, end)), shape=(len(verts), len(verts)))
    near = near + near.T
    count = np.asarray(near.sum(1)).ravel()
    border = np.zeros(len(verts), np.bool_)
    border[np.concatenate([start[mesh.twin.ravel() < 0], end[mesh.twin.ravel() < 0]])] = True
    for _ in range(_TIMES):
        normals = _normals(verts, faces)
        moved, _ = project(near @ verts / count[:, None], normals)
        verts = np.where(border[:, None], verts, moved)
    return CleanMesh(verts, faces, mesh.twin, mesh.topology, mesh.cleaned)


def _normals(verts: _Floats, faces: NDArray[np.int64]) -> _Floats:
    """Return unit normals (V, 3), means of the faces' by area; zero where they cancel."""
    a, b, c = verts[faces].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    total = np.stack(
        [sum(np.bincount(faces[:, k], cross[:, axis], len(verts)) for k in range(3)) for axis in range(3)], 1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(np.divide(total, length, out=np.zeros_like(total), where=length > 1e-300))
