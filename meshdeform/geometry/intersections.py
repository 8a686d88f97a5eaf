"""Find the self-intersections of a triangle mesh: faces that cut another, pairs that cut or touch each other.

Bounding boxes are swept along the longest axis, in strips of the second longest; faces whose boxes meet are tested
(`triangle_pairs.py`). The number of pairs is not bounded by that of the faces: a few thousand copies of one box lie in
one place. So a search does an amount of work that grows with the faces only, many times what the surface of an object
takes, and gives up beyond it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.triangle_pairs import faces_cut, faces_touch

__all__ = ["TooManyPairsError", "cutting_pairs", "intersecting_faces", "touching_pairs"]

_STRIPS = 32
"""Strips of the second axis in a sweep; a face is in all that its box meets."""

_TESTS, _TESTS_OF_FACE = 1_000_000, 50
"""Pairs that a search may test, and more for each face. A scan of an object takes 10 to 20 for each."""

_LISTED, _LISTED_OF_FACE = 1_000_000, 10
"""Pairs that a search may find, and more for each face; they are kept in memory."""

_BOXES_OF_TEST = 250
"""Comparisons of two boxes that take as long as the test of a pair."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]


class TooManyPairsError(Exception):
    """So many faces lie on or in each other that their pairs are not all tested."""


@kernel
def _in_strips(low: _Floats, high: _Floats) -> tuple[_Index, _Index, _Index, _Index]:
    """Return the first and the last strip (F,) of each box, the boxes of all strips, and where each strip's begin."""
    begin, extent = low[:, 1].min(), high[:, 1].max() - low[:, 1].min()
    scale = _STRIPS / extent if 0.0 < extent < np.inf else 0.0
    first, last = np.empty(len(low), np.int64), np.empty(len(low), np.int64)
    ends = np.zeros(_STRIPS + 1, np.int64)
    for f in range(len(low)):
        first[f] = min(int((low[f, 1] - begin) * scale), _STRIPS - 1)
        last[f] = min(int((high[f, 1] - begin) * scale), _STRIPS - 1)
        for strip in range(first[f], last[f] + 1):
            ends[strip + 1] += 1
    for strip in range(_STRIPS):
        ends[strip + 1] += ends[strip]
    filled = ends.copy()
    members = np.empty(ends[-1], np.int64)
    for f in range(len(low)):
        for strip in range(first[f], last[f] + 1):
            members[filled[strip]] = f
            filled[strip] += 1
    return first, last, members, ends


@kernel
def _sweep(
    verts: _Floats, faces: _Index, low: _Floats, high: _Floats, reach: _Floats, work: int, hit: _Flags, out: _Index
) -> int:
    """Mark the faces of all pairs in `hit`, or list the pairs in `out` and return their number; -1 if it gives up.

    Boxes (F, 3) are sorted by their lower end on the first axis. The second axis is divided into strips, each of which
    is swept alone: most boxes that overlap on the first axis are in other strips. A pair is tested in the first strip
    that has both. A pair cuts each other or, with a `reach` (F,), touches. `work` is counted in comparisons of boxes.
    """
    first, _, members, ends = _in_strips(low, high)
    found, listing, touching = 0, len(hit) == 0, len(reach) > 0
    for strip in range(_STRIPS):
        for a in range(ends[strip], ends[strip + 1]):
            f = members[a]
            if work < 0:
                return -1
            for b in range(a + 1, ends[strip + 1]):
                g = members[b]
                work -= 1
                if low[g, 0] > high[f, 0]:
                    break
                if low[g, 1] > high[f, 1] or high[g, 1] < low[f, 1]:
                    continue
                if low[g, 2] > high[f, 2] or high[g, 2] < low[f, 2]:
                    continue
                if max(first[f], first[g]) != strip or (not listing and hit[f] and hit[g]):
                    continue
                work -= _BOXES_OF_TEST
                if touching:
                    if not faces_touch(verts, faces[f], faces[g], min(reach[f], reach[g])):
                        continue
                elif not faces_cut(verts, faces[f], faces[g]):
                    continue
                if listing:
                    if found == len(out):
                        return -1
                    out[found, 0], out[found, 1] = f, g
                    found += 1
                else:
                    hit[f] = True
                    hit[g] = True
    return found


@kernel
def _boxes(verts: _Floats, faces: _Index) -> tuple[_Floats, _Floats]:
    """Return the least and the greatest coordinates (F, 3) of each face."""
    low, high = np.empty((len(faces), 3)), np.empty((len(faces), 3))
    for f in range(len(faces)):
        for c in range(3):
            x, y, z = verts[faces[f, 0], c], verts[faces[f, 1], c], verts[faces[f, 2], c]
            low[f, c], high[f, c] = min(x, y, z), max(x, y, z)
    return low, high


def _search(verts: _Floats, faces: _Index, reach: _Floats, hit: _Flags, out: _Index) -> tuple[_Index, int]:
    """Sweep the faces; return their order, of which `hit` and `out` are indices, and the number of listed pairs."""
    points = np.ascontiguousarray(verts, np.float64)
    low, high = _boxes(points, faces)
    if len(reach):
        low, high = low - reach[:, None], high + reach[:, None]
    # The longest axis separates the boxes best; in the order of the sweep they stay in the cache.
    axes = np.argsort(low.min(0) - high.max(0), kind="stable")
    order = np.argsort(low[:, axes[0]], kind="stable")
    low, high = (np.ascontiguousarray(ends[order][:, axes]) for ends in (low, high))
    work = _BOXES_OF_TEST * (_TESTS + _TESTS_OF_FACE * len(faces))
    reach = reach[order] if len(reach) else reach
    found = _sweep(points, np.ascontiguousarray(faces[order]), low, high, reach, work, hit, out)
    if found < 0:
        raise TooManyPairsError
    return order, found


def _pairs(verts: _Floats, faces: _Index, reach: _Floats) -> _Index:
    """List the pairs (P, 2) that cut each other or, with a `reach` (F,), touch: ascending, smaller index first."""
    if len(faces) < 2:
        return np.empty((0, 2), np.int64)
    # Memory that nothing is written to is not taken.
    out = np.empty((_LISTED + _LISTED_OF_FACE * len(faces), 2), np.int64)
    order, found = _search(verts, faces, reach, np.empty(0, np.bool_), out)
    pairs = np.sort(order[out[:found]], axis=1)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def intersecting_faces(verts: _Floats, faces: _Index) -> _Flags:
    """Find the faces that cut through another face of the mesh.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64

    Returns
    -------
    (F,) bool

    Raises
    ------
    TooManyPairsError
    """
    hit = np.zeros(len(faces), np.bool_)
    if len(faces) < 2:
        return hit
    sorted_hit = hit.copy()
    order, _ = _search(verts, faces, np.empty(0), sorted_hit, np.empty((0, 2), np.int64))
    hit[order] = sorted_hit
    return hit


def cutting_pairs(verts: _Floats, faces: _Index) -> _Index:
    """Find the pairs of faces that cut through each other.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64

    Returns
    -------
    (P, 2) int64
        Each pair once, smaller index first, in ascending order; the faces are those of `intersecting_faces`.

    Raises
    ------
    TooManyPairsError

    Notes
    -----
    `intersecting_faces` runs first: it is fast on faces that cut none, and usually leaves few faces to pair.
    """
    cutting = np.flatnonzero(intersecting_faces(verts, faces))
    return np.asarray(cutting[_pairs(verts, faces[cutting], np.empty(0))])


def touching_pairs(verts: _Floats, faces: _Index, reach: _Floats) -> _Index:
    """Find the pairs of faces that cut each other or come close to it.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
    reach : (F,) float64
        Distance in object units up to which a face touches another; of a pair, the smaller one applies.

    Returns
    -------
    (P, 2) int64
        Each pair once, smaller index first, in ascending order. Faces with a common edge never touch; of faces with one
        common vertex, the opposite edges count.

    Raises
    ------
    TooManyPairsError
    """
    return _pairs(verts, faces, reach)
