"""Smooth a moulded surface where it is folded or cuts itself, which happens where its faces are too large for it.

Each round moves the vertices of faulty faces, and those around them, half of the way to the mean of their neighbours;
what stays faulty for long takes more of its surroundings along. Cuts are looked for only once few folds are left, as
most of them go with the folds.

Source: Taubin 1995, A signal processing approach to fair surface design (the smoothing, whose shrinking is what unfolds
here).
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from meshdeform.exemplar.faults import Faults, Found
from meshdeform.geometry.folds import FaceNeighbours
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["unfolded"]

_ROUNDS, _ROUNDS_OF_CUTS = 24, 16
_WIDENED = 8
"""Rounds after which one more ring of vertices moves."""
_FEW = 0.001
"""Share of the faces that may be folded when cuts are looked for."""


def unfolded(rest: Floats, verts: Floats, faces: Index) -> Floats:
    """Return vertices (V, 3) near those given, with hardly a fold or a cut that there was not at rest.

    Parameters
    ----------
    rest, verts : (V, 3) float64
        Of a closed surface, no two in one point.
    faces : (F, 3) int64
    """
    neighbours, verts = FaceNeighbours(faces, rest), verts.copy()
    smoothing = _Smoothing(faces, len(verts))
    for number in range(_ROUNDS):
        bad = neighbours.folded(verts)
        if bad.sum() <= _FEW * len(faces):
            break
        smoothing.smooth(verts, bad, 1 + number // _WIDENED)
    faults, last = Faults(rest, faces), None
    best: Found | None = None
    for number in range(_ROUNDS_OF_CUTS):
        last = faults.find(verts, last)
        bad = last.folded | last.cutting
        if best is None or bad.sum() < (best.folded | best.cutting).sum():
            best = last
        if not bad.any():
            break
        verts = verts.copy()
        smoothing.smooth(verts, bad, 1 + number // _WIDENED)
    assert best is not None
    return best.verts


class _Smoothing:
    """The neighbours of the vertices of faces (F, 3), and steps toward their means."""

    def __init__(self, faces: Index, count: int) -> None:
        self._faces = faces
        ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        graph = sparse.csr_matrix((np.ones(len(ends)), tuple(ends.T)), shape=(count, count))
        self._graph = ((graph + graph.T) > 0).astype(np.float64)
        self._number = np.maximum(np.asarray(self._graph.sum(1)), 1)

    def smooth(self, verts: Floats, bad: Flags, rings: int) -> None:
        """Move the vertices of bad faces (F,), and rings of others around them, half of the way."""
        near = np.zeros(len(verts))
        near[self._faces[bad]] = 1
        for _ in range(rings):
            near += self._graph @ near
        rows = np.flatnonzero(near)
        verts[rows] = (verts[rows] + (self._graph[rows] @ verts) / self._number[rows]) / 2
