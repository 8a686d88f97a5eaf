"""Find the self-intersections of a triangle mesh: faces that cut another, pairs that cut or touch each other.

Bounding boxes are swept along the longest axis, in strips of the second longest; faces whose boxes meet are tested.
The number of pairs is not bounded by that of the faces: a few thousand copies of one box lie in one position. So a
search does an amount of work that grows with the faces only, many times what the surface of an object takes, and gives
up beyond it.

Two triangles cut each other if an edge of one passes through the other. The signs of five determinants decide this: the
edge's ends lie on different sides of the plane, and the edge's line passes on the same side of all three edges of the
triangle. A determinant closer to zero than its rounding error has no sign; then the point where the edge crosses the
plane decides. An edge that ends in the other's plane only touches it: touching and coplanar overlap do not count as
cuts.

Faces that share an edge cannot cut each other unless they are folded flat, and are not tested; of faces that share one
vertex, each one's opposite edge is tested.

Two triangles that do not cut each other are as far apart as their closest edges, or a corner and the other triangle.

Sources: Guigue and Devillers 2003, Fast and Robust Triangle-Triangle Overlap Test; Shewchuk 1997, Adaptive Precision
Floating-Point Arithmetic, for the error bound; Ericson 2005, Real-Time Collision Detection, sections 5.1.5 and 5.1.9.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.cuts import BORDER, ERROR, candidates, cut, touch
from meshdeform.geometry.kernels import Worth, kernel

_ERROR, _BORDER = ERROR, BORDER  # numba compiles them in

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_STRIPS = 32
"""Strips of the second axis in a sweep; a face is in all that its box meets."""

_FACES_OF_STRIP = 64
"""Faces for another strip of a sweep in numpy, which compares many boxes at once."""

_compiles = Worth(60_000)
"""Whether numba searches so many faces."""

_TESTS, _TESTS_OF_FACE = 1_000_000, 50
"""Pairs that a search may test, and more for each face. A scan of an object takes 10 to 20 for each."""

_LISTED, _LISTED_OF_FACE = 1_000_000, 10
"""Pairs that a search may find, and more for each face; they are kept in memory."""

_BOXES_OF_TEST = 250
"""Comparisons of two boxes that take as long as the test of a pair."""

_TOUCHING = 1e-6
"""Distance, as a share of the bounding box's diagonal, up to which faces touch at rest."""

_Flags = NDArray[np.bool_]
_CELLS = 64
"""Cells along the longest side of the grid that finds what is near."""


@kernel
def _side(a: _Floats, b: _Floats, c: _Floats, d: _Floats) -> int:
    """Return the side of the plane a b c on which d lies: -1, 1, or 0 if float64 cannot tell."""
    ax, ay, az = a[0] - d[0], a[1] - d[1], a[2] - d[2]
    bx, by, bz = b[0] - d[0], b[1] - d[1], b[2] - d[2]
    cx, cy, cz = c[0] - d[0], c[1] - d[1], c[2] - d[2]
    det = az * (bx * cy - cx * by) + bz * (cx * ay - ax * cy) + cz * (ax * by - bx * ay)
    size = (
        (abs(bx * cy) + abs(cx * by)) * abs(az)
        + (abs(cx * ay) + abs(ax * cy)) * abs(bz)
        + (abs(ax * by) + abs(bx * ay)) * abs(cz)
    )
    if det > _ERROR * size:
        return 1
    if det < -_ERROR * size:
        return -1
    return 0


@kernel
def _edge_cuts(p: _Floats, q: _Floats, a: _Floats, b: _Floats, c: _Floats) -> bool:
    """Return whether the segment p q passes through the triangle a b c from one side to the other."""
    if _side(a, b, c, p) * _side(a, b, c, q) >= 0:
        return False
    first, second, third = _side(p, q, a, b), _side(p, q, b, c), _side(p, q, c, a)
    low, high = min(first, second, third), max(first, second, third)
    if low * high < 0 or (low == 0 and high == 0):
        return False
    return bool(first * second * third != 0 or _crosses_inside(p, q, a, b, c))


@kernel
def _crosses_inside(p: _Floats, q: _Floats, a: _Floats, b: _Floats, c: _Floats) -> bool:
    """Return whether the segment p q crosses the plane a b c in the triangle or on its border."""
    # In one plane all determinants are rounding errors, so those without a sign do not tell even far from the triangle.
    nx = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    ny = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    nz = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    above = abs(nx * (p[0] - a[0]) + ny * (p[1] - a[1]) + nz * (p[2] - a[2]))
    below = abs(nx * (q[0] - a[0]) + ny * (q[1] - a[1]) + nz * (q[2] - a[2]))
    share = above / (above + below) if above + below > 0.0 else 0.5
    bb, cc, bc = _dot(a, b, a, b), _dot(a, c, a, c), _dot(a, b, a, c)
    xb = (1 - share) * _dot(a, p, a, b) + share * _dot(a, q, a, b)
    xc = (1 - share) * _dot(a, p, a, c) + share * _dot(a, q, a, c)
    v, w, size = cc * xb - bc * xc, bb * xc - bc * xb, bb * cc - bc * bc
    return bool(v >= -_BORDER * size and w >= -_BORDER * size and v + w <= (1 + _BORDER) * size)


@kernel
def _one_sided(verts: _Floats, f: _Index, g: _Index) -> bool:
    """Return whether face g lies on one side of face f's plane: the quick rejection of almost all pairs."""
    a, b, c = verts[f[0]], verts[f[1]], verts[f[2]]
    total = _side(a, b, c, verts[g[0]]) + _side(a, b, c, verts[g[1]]) + _side(a, b, c, verts[g[2]])
    return bool(abs(total) == 3)


@kernel
def _shared(f: _Index, g: _Index) -> tuple[int, int, int]:
    """Return how many vertices two faces (3,) share, and at which corner of each the last of them is, or -1."""
    shared, at_f, at_g = 0, -1, -1
    for i in range(3):
        for j in range(3):
            if f[i] == g[j]:
                shared += 1
                at_f, at_g = i, j
    return shared, at_f, at_g


@kernel
def faces_cut(verts: _Floats, f: _Index, g: _Index) -> bool:
    """Return whether faces f and g (3,) of the vertices (V, 3) cut through each other."""
    shared, at_f, at_g = _shared(f, g)
    if shared >= 2:
        return False
    if shared == 0 and (_one_sided(verts, f, g) or _one_sided(verts, g, f)):
        return False
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if (shared == 0 or i == at_f) and _edge_cuts(verts[f[j]], verts[f[k]], verts[g[0]], verts[g[1]], verts[g[2]]):
            return True
        if (shared == 0 or i == at_g) and _edge_cuts(verts[g[j]], verts[g[k]], verts[f[0]], verts[f[1]], verts[f[2]]):
            return True
    return False


@kernel
def _dot(a: _Floats, b: _Floats, c: _Floats, d: _Floats) -> float:
    """Return the scalar product of b - a and d - c."""
    return float((b[0] - a[0]) * (d[0] - c[0]) + (b[1] - a[1]) * (d[1] - c[1]) + (b[2] - a[2]) * (d[2] - c[2]))


@kernel
def _squared_to_triangle(p: _Floats, a: _Floats, b: _Floats, c: _Floats) -> float:
    """Return the squared distance of a point from a triangle's inside; infinite if its foot lies outside."""
    bb, cc, bc = _dot(a, b, a, b), _dot(a, c, a, c), _dot(a, b, a, c)
    pb, pc = _dot(a, p, a, b), _dot(a, p, a, c)
    size = bb * cc - bc * bc
    v, w = cc * pb - bc * pc, bb * pc - bc * pb
    if size <= 0.0 or v < 0.0 or w < 0.0 or v + w > size:
        return np.inf
    v, w = v / size, w / size
    total = 0.0
    for i in range(3):
        total += (p[i] - a[i] - v * (b[i] - a[i]) - w * (c[i] - a[i])) ** 2
    return total


@kernel
def _squared_between_edges(p: _Floats, q: _Floats, a: _Floats, b: _Floats) -> float:
    """Return the squared distance between the segments p q and a b."""
    dd, ee, de = _dot(p, q, p, q), _dot(a, b, a, b), _dot(p, q, a, b)
    dr, er = _dot(p, q, a, p), _dot(a, b, a, p)
    s, across = 0.0, dd * ee - de * de
    if across > 0.0:
        s = min(max((de * er - dr * ee) / across, 0.0), 1.0)
    t = min(max((de * s + er) / ee, 0.0), 1.0) if ee > 0.0 else 0.0
    if dd > 0.0:
        s = min(max((de * t - dr) / dd, 0.0), 1.0)
    total = 0.0
    for i in range(3):
        total += (p[i] + s * (q[i] - p[i]) - a[i] - t * (b[i] - a[i])) ** 2
    return total


@kernel
def _separated(p: _Floats, q: _Floats, a: _Floats, b: _Floats, c: _Floats, squared: float) -> bool:
    """Return whether a plane across the line between the centres separates them: the quick rejection of neighbours."""
    size = p_side = q_side = a_side = b_side = c_side = 0.0
    for i in range(3):
        d = (p[i] + q[i]) / 2 - (a[i] + b[i] + c[i]) / 3
        size += d * d
        p_side += p[i] * d
        q_side += q[i] * d
        a_side += a[i] * d
        b_side += b[i] * d
        c_side += c[i] * d
    gap = min(p_side, q_side) - max(a_side, b_side, c_side)
    return bool(gap > 0 and gap * gap > squared * size)


@kernel
def _edge_touches(p: _Floats, q: _Floats, a: _Floats, b: _Floats, c: _Floats, squared: float) -> bool:
    """Return whether the segment p q comes as close as that to the triangle a b c."""
    if _separated(p, q, a, b, c, squared):
        return False
    if _edge_cuts(p, q, a, b, c):
        return True
    near = min(_squared_to_triangle(p, a, b, c), _squared_to_triangle(q, a, b, c))
    near = min(near, _squared_between_edges(p, q, a, b))
    near = min(near, _squared_between_edges(p, q, b, c), _squared_between_edges(p, q, c, a))
    return bool(near <= squared)


@kernel
def faces_touch(verts: _Floats, f: _Index, g: _Index, reach: float) -> bool:
    """Return whether faces f and g (3,) of the vertices (V, 3) cut each other, or come as close as `reach`."""
    shared, at_f, at_g = _shared(f, g)
    if shared >= 2:
        return False
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if (shared == 0 or i == at_f) and _edge_touches(
            verts[f[j]], verts[f[k]], verts[g[0]], verts[g[1]], verts[g[2]], reach * reach
        ):
            return True
        if (shared == 0 or i == at_g) and _edge_touches(
            verts[g[j]], verts[g[k]], verts[f[0]], verts[f[1]], verts[f[2]], reach * reach
        ):
            return True
    return False


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
    """Mark the faces of all pairs in `hit`, or list the pairs in `out` and return their number; -1 if it gives up."""
    # Boxes (F, 3) are sorted by their lower end on the first axis. The second axis is divided into strips, each of
    # which is swept alone: most boxes that overlap on the first axis are in other strips. A pair is tested in the first
    # strip that has both. A pair cuts each other or, with a `reach` (F,), touches. `work` is counted in comparisons of
    # boxes.
    first, _, members, ends = _in_strips(low, high)
    count, listing, touching = 0, len(hit) == 0, len(reach) > 0
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
                    if count == len(out):
                        return -1
                    out[count, 0], out[count, 1] = f, g
                    count += 1
                else:
                    hit[f] = True
                    hit[g] = True
    return count


def _boxes(verts: _Floats, faces: _Index) -> tuple[_Floats, _Floats]:
    """Return the least and the greatest coordinates (F, 3) of each face."""
    a, b, c = (verts[faces[:, k]] for k in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


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
    sweep = _sweep if len(reach) or _compiles(len(faces)) else _sweep_small
    count = sweep(points, np.ascontiguousarray(faces[order]), low, high, reach, work, hit, out)
    if count < 0:
        raise TooManyPairsError
    return order, count


def _sweep_small(
    verts: _Floats, faces: _Index, low: _Floats, high: _Floats, _reach: _Floats, work: int, hit: _Flags, out: _Index
) -> int:
    """Do what `_sweep` does for cuts, without numba."""
    points, corners = np.ascontiguousarray(verts.T), np.ascontiguousarray(faces.T)
    count, listing = 0, len(hit) == 0
    for compared, f, g in candidates(low, high, max(_STRIPS, len(faces) // _FACES_OF_STRIP)):
        if not listing:
            new = ~(hit[f] & hit[g])
            f, g = f[new], g[new]
        work -= compared + _BOXES_OF_TEST * len(f)
        if work < 0:
            return -1
        cutting = cut(points, corners, f, g)
        f, g = f[cutting], g[cutting]
        if not listing:
            hit[f] = hit[g] = True
            continue
        if count + len(f) > len(out):
            return -1
        out[count : count + len(f), 0], out[count : count + len(f), 1] = f, g
        count += len(f)
    return count


def _pairs(verts: _Floats, faces: _Index, reach: _Floats) -> _Index:
    """List the pairs (P, 2) that cut each other or, with a `reach` (F,), touch: ascending, smaller index first."""
    if len(faces) < 2:
        return np.empty((0, 2), np.int64)
    # Memory that nothing is written to is not taken.
    out = np.empty((_LISTED + _LISTED_OF_FACE * len(faces), 2), np.int64)
    order, count = _search(verts, faces, reach, np.empty(0, np.bool_), out)
    pairs = np.sort(order[out[:count]], axis=1)
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

    `verts` is (V, 3) float64; `faces` is (F, 3) int64. Returns (P, 2) int64: each pair once, smaller index first, in
    ascending order; the faces are those of `intersecting_faces`. Raises TooManyPairsError.

    `intersecting_faces` runs first: it is fast on faces that cut none, and usually leaves few faces to pair.
    """
    cutting = np.flatnonzero(intersecting_faces(verts, faces))
    return np.asarray(cutting[_pairs(verts, faces[cutting], np.empty(0))])


def touching_pairs(verts: _Floats, faces: _Index, reach: _Floats) -> _Index:
    """Find the pairs of faces that cut each other or come close to it.

    `verts` is (V, 3) float64; `faces` is (F, 3) int64. `reach`, (F,) float64: distance in object units up to which a
    face touches another; of a pair, the smaller one applies. Returns (P, 2) int64: each pair once, smaller index first,
    in ascending order. Faces with a common edge never touch; of faces with one common vertex, the opposite edges count.
    Raises TooManyPairsError.
    """
    return _pairs(verts, faces, reach)


def newly_cutting_pairs(rest: _Floats, verts: _Floats, faces: _Index) -> _Index:
    """Find the pairs of faces that cut each other and at rest neither did nor touched.

    `rest` and `verts` are (V, 3) float64; `faces` is (F, 3) int64. Returns (P, 2) int64: each pair once, smaller index
    first, in ascending order. Raises TooManyPairsError.

    Faces that touch without cutting cut each other, by rounding, as soon as they are turned.
    """
    pairs = cutting_pairs(verts, faces)
    return np.asarray(pairs[~touching_at_rest(rest, faces, pairs)])


def touching_at_rest(rest: _Floats, faces: _Index, pairs: _Index) -> _Flags:
    """Return which pairs (P, 2) int64 of faces (F, 3) int64 cut each other or touch where the vertices rest, (V, 3)."""
    if not len(pairs):
        return np.zeros(0, np.bool_)
    reach = _TOUCHING * float(np.linalg.norm(np.ptp(rest, axis=0)))
    points, corners = np.ascontiguousarray(rest.T, np.float64), np.ascontiguousarray(faces.T)
    return touch(points, corners, pairs[:, 0], pairs[:, 1], reach)


def _in_marked_cells(low: _Index, high: _Index, some: _Flags, shape: tuple[int, ...]) -> _Flags:
    """Return which boxes (F,), in cells of a grid, meet a cell that some of them meet."""
    # Sums over a box are those from the origin to its corners: of what begins and ends in cells, and of what is met.
    met = np.zeros([side + 1 for side in shape], np.int32)
    for corner in product((0, 1), repeat=3):
        at = np.where(corner, high[some] + 1, low[some])
        np.add.at(met, tuple(at.T), (-1) ** sum(corner))
    for axis in range(3):
        np.cumsum(met, axis, out=met)
    sums = np.zeros([side + 1 for side in shape], np.int32)
    sums[1:, 1:, 1:] = met[:-1, :-1, :-1] > 0
    for axis in range(3):
        np.cumsum(sums, axis, out=sums)
    found = np.zeros(len(low), np.int32)
    for corner in product((0, 1), repeat=3):
        at = np.where(corner, high + 1, low)
        found += (-1) ** (3 - sum(corner)) * sums[tuple(at.T)]
    return np.asarray(found > 0)


def faces_near(verts: _Floats, faces: _Index, some: _Flags) -> _Flags:
    """Find the faces that may touch some of them: those in cells of a grid that these meet, and these.

    `verts` is (V, 3) float64; `faces` is (F, 3) int64; `some` is (F,) bool. Returns (F,) bool.
    """
    if not some.any():
        return some.copy()
    low, high = _boxes(np.ascontiguousarray(verts, np.float64), faces)
    origin, far = low.min(0), high.max(0)
    scale = _CELLS / max(float((far - origin).max()), 1e-300)
    shape = ((far - origin) * scale).astype(np.int64) + 1
    first, last = (np.clip((ends - origin) * scale, 0, shape - 1).astype(np.int64) for ends in (low, high))
    return _in_marked_cells(first, last, some, tuple(shape))
