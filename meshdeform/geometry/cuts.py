"""Test pairs of faces for cuts and contacts in numpy: what `intersections` compiles for large meshes, without numba.

Both compute the same numbers in the same order, so their answers are the same to the last pair. These take
eight times the time on large meshes, and nothing before the first pair, for which numba takes half a second.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["BORDER", "ERROR", "candidates", "cut", "touch"]

ERROR = 8.0e-16
"""Relative rounding error of a determinant of differences: (7 + 56 eps) eps with eps = 2^-53."""

BORDER = 1e-9
"""Barycentric coordinate below zero that counts as on the border."""

_AT_ONCE = 1 << 17
"""Pairs of boxes in memory at a time, unless one box has more."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]
_Signs = NDArray[np.int8]
_Triangles = tuple[_Floats, _Floats, _Floats]
"""Corners, each (3, P) float64."""


def candidates(low: _Floats, high: _Floats, strips: int) -> Iterator[tuple[int, _Index, _Index]]:
    """List the pairs of boxes that meet, each once, a batch at a time.

    Parameters
    ----------
    low, high : (F, 3) float64
        Sorted by the lower end on the first axis.
    strips : int
        Of the second axis; each is swept alone, and a pair belongs to the first strip that has both.

    Yields
    ------
    The number of boxes that were compared, and the smaller and the greater indices (P,) of pairs that meet.
    """
    begin, extent = low[:, 1].min(), high[:, 1].max() - low[:, 1].min()
    scale = strips / extent if 0.0 < extent < np.inf else 0.0
    first, last = (np.minimum(((ends[:, 1] - begin) * scale).astype(np.int64), strips - 1) for ends in (low, high))
    counts = last - first + 1
    owner = np.repeat(np.arange(len(low)), counts)
    strip = first[owner] + _within(counts)
    order = np.argsort(strip, kind="stable")
    owner, strip = owner[order], strip[order]
    bounds = np.searchsorted(strip, np.arange(strips + 1))
    ends = np.empty(len(owner), np.int64)
    for at, end in pairwise(bounds):
        members = owner[at:end]
        ends[at:end] = at + np.searchsorted(low[members, 0], high[members, 0], "right")
    after = ends - np.arange(len(owner)) - 1
    total = np.concatenate([[0], np.cumsum(after)])
    y, z = ((np.ascontiguousarray(low[:, axis]), np.ascontiguousarray(high[:, axis])) for axis in (1, 2))
    at = 0
    while at < len(owner):
        end = max(at + 1, int(np.searchsorted(total, total[at] + _AT_ONCE, "right")) - 1)
        one = np.repeat(np.arange(at, end), after[at:end])
        f, g = owner[one], owner[one + 1 + _within(after[at:end])]
        meet = _overlap(y, f, g) & _overlap(z, f, g) & (np.maximum(first[f], first[g]) == strip[one])
        yield len(f), f[meet], g[meet]
        at = end


def _within(counts: _Index) -> _Index:
    """Return the numbers 0 .. c - 1 for each count c, one after the other."""
    return np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)


def _overlap(ends: tuple[_Floats, _Floats], f: _Index, g: _Index) -> _Flags:
    return np.asarray((ends[0][g] <= ends[1][f]) & (ends[1][g] >= ends[0][f]))


def cut(points: _Floats, faces: _Index, f: _Index, g: _Index) -> _Flags:
    """Return which pairs (P,) of faces (3, F) of points (3, V) cut through each other."""
    alike = _alike(faces, f, g)
    shared, found = alike.sum((0, 1)), np.zeros(len(f), bool)
    apart = np.flatnonzero(shared == 0)
    if len(apart):
        own, other = (_corners(points, faces, each[apart]) for each in (f, g))
        of_other = [_side(*own, corner) for corner in other]
        # The quick rejection of almost all pairs: one face is on one side of the other's plane.
        kept = np.abs(sum(of_other)) < 3
        apart, own, other, of_other = apart[kept], _some(own, kept), _some(other, kept), _signs(of_other, kept)
        of_own = [_side(*other, corner) for corner in own]
        kept = np.abs(sum(of_own)) < 3
        apart, own, other = apart[kept], _some(own, kept), _some(other, kept)
        of_other, of_own = _signs(of_other, kept), _signs(of_own, kept)
        hit = np.zeros(len(apart), bool)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            hit |= _edge_cuts(own[j], own[k], other, of_own[j] * of_own[k])
            hit |= _edge_cuts(other[j], other[k], own, of_other[j] * of_other[k])
        found[apart] = hit
    beside = np.flatnonzero(shared == 1)
    if len(beside):
        for (p, q), triangle in _opposite_edges(points, faces, f[beside], g[beside], alike[:, :, beside]):
            found[beside] |= _edge_cuts(p, q, triangle, _side(*triangle, p) * _side(*triangle, q))
    return found


def touch(points: _Floats, faces: _Index, f: _Index, g: _Index, reach: float) -> _Flags:
    """Return which pairs (P,) of faces (3, F) of points (3, V) cut each other, or come as close as `reach`."""
    alike = _alike(faces, f, g)
    shared, found = alike.sum((0, 1)), np.zeros(len(f), bool)
    apart = np.flatnonzero(shared == 0)
    own, other = (_corners(points, faces, each[apart]) for each in (f, g))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        found[apart] |= _edge_touches(own[j], own[k], other, reach * reach)
        found[apart] |= _edge_touches(other[j], other[k], own, reach * reach)
    beside = np.flatnonzero(shared == 1)
    for (p, q), triangle in _opposite_edges(points, faces, f[beside], g[beside], alike[:, :, beside]):
        found[beside] |= _edge_touches(p, q, triangle, reach * reach)
    return found


def _alike(faces: _Index, f: _Index, g: _Index) -> _Flags:
    """Return which corners (3, 3, P) of the two faces are one vertex."""
    return np.asarray(faces[:, None, f] == faces[None][:, :, g])


def _opposite_edges(
    points: _Floats, faces: _Index, f: _Index, g: _Index, alike: _Flags
) -> Iterator[tuple[tuple[_Floats, _Floats], _Triangles]]:
    """Return the edge of each face that is opposite to the only vertex that both have, and the other face."""
    for own, other, at in ((f, g, alike.any(1).argmax(0)), (g, f, alike.any(0).argmax(0))):
        ends = points[:, faces[(at + 1) % 3, own]], points[:, faces[(at + 2) % 3, own]]
        yield ends, _corners(points, faces, other)


def _corners(points: _Floats, faces: _Index, some: _Index) -> _Triangles:
    a, b, c = (points[:, faces[k, some]] for k in range(3))
    return a, b, c


def _some(triangles: _Triangles, kept: _Flags | _Index) -> _Triangles:
    a, b, c = triangles
    return a[:, kept], b[:, kept], c[:, kept]


def _signs(sides: Sequence[_Signs], kept: _Flags) -> list[_Signs]:
    return [each[kept] for each in sides]


def _side(a: _Floats, b: _Floats, c: _Floats, d: _Floats) -> _Signs:
    """Return the side (P,) of the plane a b c on which d lies: -1, 1, or 0 if float64 cannot tell."""
    ax, ay, az = a[0] - d[0], a[1] - d[1], a[2] - d[2]
    bx, by, bz = b[0] - d[0], b[1] - d[1], b[2] - d[2]
    cx, cy, cz = c[0] - d[0], c[1] - d[1], c[2] - d[2]
    bc, cb, ca, ac, ab, ba = bx * cy, cx * by, cx * ay, ax * cy, ax * by, bx * ay
    determinant = az * (bc - cb) + bz * (ca - ac) + cz * (ab - ba)
    size = (np.abs(bc) + np.abs(cb)) * np.abs(az) + (np.abs(ca) + np.abs(ac)) * np.abs(bz)
    limit = ERROR * (size + (np.abs(ab) + np.abs(ba)) * np.abs(cz))
    return np.asarray((determinant > limit).astype(np.int8) - (determinant < -limit).astype(np.int8))


def _edge_cuts(p: _Floats, q: _Floats, triangle: _Triangles, sides: _Signs) -> _Flags:
    """Return which segments p q pass through their triangle; `sides`: the products of the sides of their ends."""
    found = np.zeros(len(sides), bool)
    some = np.flatnonzero(sides < 0)
    if not len(some):
        return found
    p, q, (a, b, c) = p[:, some], q[:, some], _some(triangle, some)
    around = np.stack([_side(p, q, a, b), _side(p, q, b, c), _side(p, q, c, a)])
    low, high = around.min(0), around.max(0)
    through = ~((low * high < 0) | ((low == 0) & (high == 0)))
    unsure = np.flatnonzero(through & (around == 0).any(0))
    if len(unsure):
        ends = p[:, unsure], q[:, unsure]
        through[unsure] = _crosses_inside(*ends, *_some((a, b, c), unsure))
    found[some] = through
    return found


def _crosses_inside(p: _Floats, q: _Floats, a: _Floats, b: _Floats, c: _Floats) -> _Flags:
    """Return which segments p q cross the plane a b c in the triangle or on its border."""
    nx = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    ny = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    nz = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    above, below = (np.abs(nx * (end[0] - a[0]) + ny * (end[1] - a[1]) + nz * (end[2] - a[2])) for end in (p, q))
    total = above + below
    share = np.where(total > 0.0, above / np.where(total > 0.0, total, 1.0), 0.5)
    bb, cc, bc = _dot(a, b, a, b), _dot(a, c, a, c), _dot(a, b, a, c)
    xb = (1 - share) * _dot(a, p, a, b) + share * _dot(a, q, a, b)
    xc = (1 - share) * _dot(a, p, a, c) + share * _dot(a, q, a, c)
    v, w, size = cc * xb - bc * xc, bb * xc - bc * xb, bb * cc - bc * bc
    return np.asarray((v >= -BORDER * size) & (w >= -BORDER * size) & (v + w <= (1 + BORDER) * size))


def _dot(a: _Floats, b: _Floats, c: _Floats, d: _Floats) -> _Floats:
    """Return the scalar products (P,) of b - a and d - c."""
    product = (b[0] - a[0]) * (d[0] - c[0]) + (b[1] - a[1]) * (d[1] - c[1]) + (b[2] - a[2]) * (d[2] - c[2])
    return np.asarray(product)


def _edge_touches(p: _Floats, q: _Floats, triangle: _Triangles, squared: float) -> _Flags:
    """Return which segments p q come as close as that to their triangle."""
    a, b, c = triangle
    cuts = _edge_cuts(p, q, triangle, _side(*triangle, p) * _side(*triangle, q))
    near = np.minimum(_squared_to_triangle(p, a, b, c), _squared_to_triangle(q, a, b, c))
    for one, other in ((a, b), (b, c), (c, a)):
        near = np.minimum(near, _squared_between_edges(p, q, one, other))
    return np.asarray(cuts | (near <= squared))


def _squared_to_triangle(p: _Floats, a: _Floats, b: _Floats, c: _Floats) -> _Floats:
    """Return the squared distances of points from the insides of triangles; infinite if the foot lies outside."""
    bb, cc, bc = _dot(a, b, a, b), _dot(a, c, a, c), _dot(a, b, a, c)
    pb, pc = _dot(a, p, a, b), _dot(a, p, a, c)
    size = bb * cc - bc * bc
    v, w = cc * pb - bc * pc, bb * pc - bc * pb
    inside = (size > 0.0) & (v >= 0.0) & (w >= 0.0) & (v + w <= size)
    scale = np.where(inside, size, 1.0)
    v, w = v / scale, w / scale
    return np.where(inside, _squared(p[i] - a[i] - v * (b[i] - a[i]) - w * (c[i] - a[i]) for i in range(3)), np.inf)


def _squared_between_edges(p: _Floats, q: _Floats, a: _Floats, b: _Floats) -> _Floats:
    """Return the squared distances between the segments p q and a b."""
    dd, ee, de = _dot(p, q, p, q), _dot(a, b, a, b), _dot(p, q, a, b)
    dr, er = _dot(p, q, a, p), _dot(a, b, a, p)
    across = dd * ee - de * de
    s = np.where(across > 0.0, np.clip((de * er - dr * ee) / np.where(across > 0.0, across, 1.0), 0.0, 1.0), 0.0)
    t = np.where(ee > 0.0, np.clip((de * s + er) / np.where(ee > 0.0, ee, 1.0), 0.0, 1.0), 0.0)
    s = np.where(dd > 0.0, np.clip((de * t - dr) / np.where(dd > 0.0, dd, 1.0), 0.0, 1.0), s)
    return _squared(p[i] + s * (q[i] - p[i]) - a[i] - t * (b[i] - a[i]) for i in range(3))


def _squared(coordinates: Iterator[_Floats]) -> _Floats:
    """Return the sum of the squares of three coordinates."""
    x, y, z = coordinates
    return np.asarray(x**2 + y**2 + z**2)
