"""Find folds: faces of a deformed surface that point against their neighbours and did not at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.geometry.mesh import face_cross

_Floats = NDArray[np.float64]
_Faces = NDArray[np.int64]

_UNMOVED = 1e-7
"""Displacement, as a share of the bounding box's diagonal, that counts as none: about what 32-bit floats resolve.
Rounding would otherwise flip needles and make sheets that touch cut each other."""

_ROUNDING = 1e-15
"""Of the largest coordinate: what entering and leaving another frame may change."""


def area_vectors(verts: _Floats, faces: _Faces) -> _Floats:
    """Return the cross products (F, 3) float64 of two edges of each face: normals as long as twice the area.

    Parameters
    ----------
    verts : (V, 3) floating
    faces : (F, 3) int64
    """
    return np.asarray(face_cross(verts, faces), np.float64)


def longest_squared(verts: _Floats, faces: _Faces) -> _Floats:
    """Return the squared length (F,) of each face's longest edge."""
    corners = verts[faces]
    return np.asarray(((corners - corners[:, [1, 2, 0]]) ** 2).sum(2).max(1, initial=0.0))


def without_rounding(rest: _Floats, verts: _Floats) -> _Floats:
    """Return the positions (V, 3) with those of vertices that hardly moved replaced by their rest positions."""
    diagonal = float(np.linalg.norm(np.ptp(rest, axis=0))) if len(rest) else 0.0
    limit = _UNMOVED * diagonal + _ROUNDING * float(np.abs(rest).max(initial=0.0))
    moved = verts - rest
    still = np.einsum("ij,ij->i", moved, moved) <= limit**2
    return np.where(still[:, None], rest, verts)


class FaceNeighbours:
    """Neighbours of each face and their relative winding, to detect folds in any shape of the same faces.

    A face is folded if its area vector points against the sum of its neighbours' and, where the shape at rest is given,
    if the creases to them were bent by more than a right angle since::

        sum_g A_f . A_g < 0    and    sum_g |A_f| |A_g| cos(theta_fg - theta_fg at rest) < 0

    with the dihedral angle theta_fg, 0 where two faces are in one plane. The second sum makes bending a crease of the
    asset a little further no fold: a narrow strip beside a large face points against it once their crease has 91
    degrees. At rest nothing is folded.

    Neighbours are two faces at an edge of no other face. Faces of the same three vertices count as one face, whatever
    their winding, and neighbours may have inconsistent winding: folds do not depend on orientation, so a Moebius strip,
    a double-sided sheet and inconsistent winding have none at rest. `faces` is (F, 3) int64. `rest`, (V, 3) float64:
    the shape whose creases are no folds; without it, a surface that is smooth there.
    """

    def __init__(self, faces: _Faces, rest: _Floats | None = None) -> None:
        ordered, self._same = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
        self._faces = ordered
        count, n = len(ordered), int(faces.max(initial=0)) + 1
        # With corners a < b < c, the edges a b and b c run upwards and c a downwards.
        key = np.concatenate([ordered[:, i] * n + ordered[:, j] for i, j in ((0, 1), (1, 2), (0, 2))])
        owner, upward = np.tile(np.arange(count), 3), np.repeat([True, True, False], count)
        order = np.argsort(key, kind="stable")
        _, first, counts = np.unique(key[order], return_index=True, return_counts=True)
        f, g = order[first[counts == 2]], order[first[counts == 2] + 1]
        sign = np.where(upward[f] == upward[g], -1.0, 1.0)
        self._rows, self._columns = np.concatenate([owner[f], owner[g]]), np.concatenate([owner[g], owner[f]])
        self._sign, self._edges = np.tile(sign, 2), np.tile(np.stack(np.divmod(key[f], n), 1), (2, 1))
        self._signs = sparse.csr_matrix((self._sign, (self._rows, self._columns)), shape=(count, count))
        self._rest = None if rest is None else np.ascontiguousarray(rest)

    def folded(self, verts: _Floats) -> NDArray[np.bool_]:
        """Find the folded faces (F,)."""
        cross = area_vectors(verts, self._faces)
        against = ((self._signs @ cross) * cross).sum(1) < 0
        if self._rest is not None and against.any():
            beside = np.flatnonzero(against[self._rows])
            face = self._rows[beside]
            cosine, sine = self._dihedral(self._rest, area_vectors(self._rest, self._faces), beside).T
            length = np.hypot(cosine, sine)
            cosine, sine = np.where(length > 0, cosine, 1.0), np.where(length > 0, sine, 0.0)
            now = self._dihedral(verts, cross, beside)
            bent = (now[:, 0] * cosine + now[:, 1] * sine) / np.where(length > 0, length, 1.0)
            against &= np.bincount(face, bent, len(against)) < 0
        return np.asarray(against[self._same.reshape(-1)])

    def _dihedral(self, verts: _Floats, cross: _Floats, pairs: NDArray[np.int64]) -> _Floats:
        """Return the cosine and the sine (P, 2) of the angles between faces, times the areas of both."""
        own, other = cross[self._rows[pairs]], self._sign[pairs, None] * cross[self._columns[pairs]]
        ends = verts[self._edges[pairs]]
        along = ends[:, 1] - ends[:, 0]
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        return np.stack([(own * other).sum(1), (own * np.cross(along, other)).sum(1)], 1)
