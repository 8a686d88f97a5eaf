"""Let details follow the large faces that they lie on.

A face stays flat while the map of space bends, so the chord of a face that is longer than a cell leaves the map: a beam
would sink into its wall, a window come off its door. With W(p) x where the map has p for the nodes x, a vertex p near
a larger face of a component that its own one touches follows that face::

    x(p) = W(p) x + s(d) (sum_i b_i x(v_i) - W(q) x)

with q the nearest point on the face, b its barycentric coordinates, v_i the corners, and s(d) falling from 1 to 0 over
the distances d = |p - q| from half a cell to a whole one. Only the weights with which vertices follow the nodes change,
so it costs no step anything. A vertex follows only faces larger than all of its own; the corners of the face may follow
a larger one themselves, or lie on an edge of another face, which they then follow (`geometry/junctions.py`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.deformation.lattice import Lattice
from meshdeform.geometry.large_faces import LargeFaces, nearest_larger_faces
from meshdeform.geometry.mesh import RestMesh

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_MOST_FOLLOWED = 64
"""Faces and edges that are followed one after the other; with each, what is left becomes less."""
_CONTACT, _FULLY = 0.1, 0.5
"""Distances, in cells, up to which a component touches a face, and up to which its vertices follow that fully."""


def pull_of_large_faces(lattice: Lattice, mesh: RestMesh) -> sparse.csr_matrix:
    """Return the corrections (V, N) of the weights with which the vertices of a mesh follow the nodes of a lattice."""
    verts, faces = mesh.verts, mesh.faces
    nothing = sparse.csr_matrix((len(verts), len(lattice.keys)))
    corners = verts[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    large = np.flatnonzero(longest > lattice.spacing)
    own = np.zeros(len(verts))
    np.maximum.at(own, faces.ravel(), np.repeat(mesh.areas, 3))
    component = mesh.components
    large_faces = LargeFaces(corners[large], mesh.areas[large], component[faces[large, 0]])
    reaches = (_CONTACT * lattice.spacing, lattice.spacing)
    nearest, shares, distances = nearest_larger_faces(verts, own, component, large_faces, *reaches)
    nearest[mesh.junctions.verts] = -1  # these follow edges, whatever else is near
    followers = np.flatnonzero(nearest >= 0)
    if not len(followers):
        return nothing
    face, shares = large[nearest[followers]], shares[followers]
    near = 1 - np.clip((distances[followers] / lattice.spacing - _FULLY) / (1 - _FULLY), 0, 1)
    strength = (near**2 * (3 - 2 * near))[:, None]
    followed, column = np.unique(faces[face], return_inverse=True)
    pull = _rows(len(verts), len(followed), followers, column.reshape(-1, 3), strength * shares)
    followed_points = np.einsum("pi,pij->pj", shares, corners[face])
    left = _rows(len(verts), len(followers), followers, np.arange(len(followers))[:, None], strength)
    step = pull @ lattice.embedding(verts[followed]) - left @ lattice.embedding(followed_points)
    rows = mesh.junctions.verts
    if len(rows):
        pull = sparse.csr_matrix((pull.data, followed[pull.indices], pull.indptr), shape=(len(verts), len(verts)))
        on_edge = _rows(len(verts), len(verts), rows, rows[:, None], np.ones((len(rows), 1)))
        follow = (on_edge @ mesh.junctions.follow).tocsr()
        used = np.union1d(rows, follow.indices)
        pull, step = pull + follow, step + (follow - on_edge)[:, used] @ lattice.embedding(verts[used])
        followed = np.arange(len(verts))
    added = nothing
    # The corners of a face may follow a larger one, or lie on an edge, which is how often this goes on.
    for _ in range(_MOST_FOLLOWED):
        if not step.nnz:
            break
        added, step = added + step, pull @ step[followed]
        step.eliminate_zeros()
    return added.tocsr()


def _rows(count: int, columns: int, rows: _Index, entries: _Index, values: _Floats) -> sparse.csr_matrix:
    """Return a sparse matrix with a few entries (R, K) in some of its rows (R,)."""
    repeated = np.repeat(rows, entries.shape[1])
    return sparse.csr_matrix((values.ravel(), (repeated, entries.ravel())), shape=(count, columns))
