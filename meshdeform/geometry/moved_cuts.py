"""Tell new cuts from earlier ones that moved on: where a wheel stands in a body and grows, it cuts other faces.

A new cut of two pieces is an earlier one if these cut each other at rest no farther away than they moved against each
other there, and not far. A cut is as far away as the middles at rest of its smaller faces, less their sizes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.geometry.intersections import cutting_pairs, newly_cutting_pairs
from meshdeform.geometry.mesh import connected_components

__all__ = ["newly_cut"]

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]
_FAR = 0.1
"""Share of the diagonal beyond which a cut is another."""


def newly_cut(rest: _Floats, verts: _Floats, faces: _Index) -> _Flags:
    """Find the faces that cut others as they did not at rest, without those whose cut moved on.

    `rest` and `verts` are (V, 3) float64; `faces` is (F, 3) int64. Returns (F,) bool. Raises TooManyPairsError.
    """
    new, old = newly_cutting_pairs(rest, verts, faces), cutting_pairs(rest, faces)
    count = len(rest)
    pieces = connected_components(faces, count)[faces[:, 0]]
    most = _FAR * float(np.linalg.norm(np.ptp(rest, axis=0)))
    between = [np.sort(pieces[pairs], axis=1) @ np.array([count, 1]) for pairs in (new, old)]
    at_new, size_new = _smaller_faces(rest[faces], new)
    at_old, size_old = _smaller_faces(rest[faces], old)
    corners = (verts - rest)[faces]
    apart = np.linalg.norm(corners[new[:, 0], :, None] - corners[new[:, 1], None], axis=3).max((1, 2))
    anew = np.ones(len(new), bool)
    orders = [np.argsort(pairs, kind="stable") for pairs in between]
    grouped = [pairs[order] for pairs, order in zip(between, orders, strict=True)]
    for pair in np.intersect1d(*between):
        if pair // count == pair % count:
            continue  # a piece that folds through itself
        mine, theirs = (
            order[slice(*np.searchsorted(pairs, [pair, pair + 1]))]
            for pairs, order in zip(grouped, orders, strict=True)
        )
        far, nearest = cKDTree(at_old[theirs]).query(at_new[mine])
        anew[mine] = far > np.minimum(apart[mine], most) + size_new[mine] + size_old[theirs[nearest]]
    found = np.zeros(len(faces), bool)
    found[new[anew]] = True
    return found


def _smaller_faces(corners: _Floats, pairs: _Index) -> tuple[_Floats, _Floats]:
    """Return the middles (P, 3) and sizes (P,) of the smaller faces of pairs; corners: (F, 3, 3)."""
    middles = corners.mean(1)
    sizes = np.linalg.norm(corners - middles[:, None], axis=2).max(1)
    smaller = np.where(sizes[pairs[:, 0]] <= sizes[pairs[:, 1]], pairs[:, 0], pairs[:, 1])
    return middles[smaller], sizes[smaller]
