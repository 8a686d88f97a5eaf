"""Walk to the nearest points of a surface in numpy: what `nearest_points` compiles for many points, without numba.

Both compute the same numbers in the same order, so they find the same points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["walked"]

_SURELY = 1 + 1e-9
"""Factor beyond which a bound is greater, whatever rounding did to it."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


def walked(
    points: _Floats,
    start: _Index,
    verts: _Floats,
    faces: _Index,
    around: _Index,
    begin: _Index,
    *,
    most_moves: int,
    most_around: int,
) -> tuple[_Index, _Floats]:
    """Walk from a face to the nearest one around it as long as that is nearer.

    Parameters
    ----------
    points : (P, 3) float64
    start : (P,) int64
        The face from which each walk begins.
    around, begin : (K,) int64, (V + 1,) int64
        The faces around all vertices, in the order of the vertices, and where those of each begin.
    most_moves, most_around : int
        Moves of a walk, and faces around a vertex that are looked at.

    Returns
    -------
    The face (P,) where each walk ends, and the barycentric coordinates (P, 3) of the nearest point of it.
    """
    queries, coordinates = np.ascontiguousarray(points.T), np.ascontiguousarray(verts.T)
    corners = np.ascontiguousarray(faces.T)
    middles, radii = _balls(coordinates, corners)
    face = start.copy()
    best, weights = _nearest(queries, coordinates, corners[:, face])
    ends = np.minimum(begin[1:], begin[:-1] + most_around)
    walking = np.arange(len(points))
    for _ in range(most_moves):
        at = corners[:, face[walking]].T.ravel()
        counts = ends[at] - begin[at]
        first = np.repeat(begin[at] - (np.cumsum(counts) - counts), counts)
        other = around[first + np.arange(len(first))]
        owner = np.repeat(walking, counts.reshape(-1, 3).sum(1))
        # Most faces around are farther away than what was found, whatever they look like.
        apart = np.sqrt(_squared(queries[:, owner] - middles[:, other])) - radii[other]
        near = np.flatnonzero((apart < 0.0) | (apart * apart < _SURELY * best[owner]))
        owner, other = owner[near], other[near]
        squared, there = _nearest(queries[:, owner], coordinates, corners[:, other])
        nearer = np.flatnonzero(squared < best[owner])
        if not len(nearer):
            break
        # Of each point the nearest, and of equals the first.
        order = nearer[np.lexsort((squared[nearer], owner[nearer]))]
        chosen = order[np.append(True, owner[order][1:] != owner[order][:-1])]
        walking = owner[chosen]
        best[walking], face[walking], weights[:, walking] = squared[chosen], other[chosen], there[:, chosen]
    return face, np.ascontiguousarray(weights.T)


def _balls(verts: _Floats, corners: _Index) -> tuple[_Floats, _Floats]:
    """Return the centre (3, F) and the radius (F,) of a ball around each triangle."""
    a, b, c = (verts[:, corners[k]] for k in range(3))
    middles = (a + b + c) / 3
    return middles, np.sqrt(np.maximum.reduce([_squared(corner - middles) for corner in (a, b, c)]))


def _squared(vectors: _Floats) -> _Floats:
    return _dot(vectors, vectors)


def _nearest(points: _Floats, verts: _Floats, corners: _Index) -> tuple[_Floats, _Floats]:
    """Return the squared distances (P,) of points (3, P) from triangles, and the coordinates (3, P) nearest to them."""
    a, b, c = (verts[:, corners[k]] for k in range(3))
    ab, ac, ap, bp, cp = b - a, c - a, points - a, points - b, points - c
    d1, d2, d3 = _dot(ab, ap), _dot(ac, ap), _dot(ab, bp)
    d4, d5, d6 = _dot(ac, bp), _dot(ab, cp), _dot(ac, cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    across = _quotient(d4 - d3, (d4 - d3) + (d5 - d6))
    # Corner a, corner b, corner c, edge a b, edge a c, edge b c; else the inside.
    cases = [
        (d1 <= 0.0) & (d2 <= 0.0),
        (d3 >= 0.0) & (d4 <= d3),
        (d6 >= 0.0) & (d5 <= d6),
        (vc <= 0.0) & (d1 >= 0.0) & (d3 <= 0.0),
        (vb <= 0.0) & (d2 >= 0.0) & (d6 <= 0.0),
        (va <= 0.0) & (d4 - d3 >= 0.0) & (d5 - d6 >= 0.0),
    ]
    total, none, one = va + vb + vc, np.zeros(len(d1)), np.ones(len(d1))
    v = np.select(cases, [none, one, none, _quotient(d1, d1 - d3), none, 1.0 - across], _quotient(vb, total))
    w = np.select(cases, [none, none, one, none, _quotient(d2, d2 - d6), across], _quotient(vc, total))
    apart = ap - v * ab - w * ac
    return _dot(apart, apart), np.stack([1.0 - v - w, v, w])


def _dot(one: _Floats, other: _Floats) -> _Floats:
    """Return the scalar products (P,) of vectors (3, P), added in the order of the axes."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


def _quotient(share: _Floats, total: _Floats) -> _Floats:
    return np.asarray(np.divide(share, total, out=np.zeros_like(share), where=total != 0.0))
