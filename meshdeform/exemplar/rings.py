"""Take vertices out of a closed surface one by one by half-edge collapses, and put them back in.

The surface is kept as the ring of each vertex, its neighbours counter-clockwise. A collapse moves a vertex u to a
neighbour v; both have exactly two neighbours in common, so that what is left is a surface of the same topology. The
ring of u is kept as it was: it and v are all that undoing the collapse takes, in the opposite order.

The cheapest collapse comes first, by the error of quadrics and a little by length. An apex that closes a disc never
goes, and its ring is not kept; the neighbours of the apex, which are `bound`, go only to each other and stay one
circle without chords.

Sources: Hoppe 1996, Progressive Meshes; Garland and Heckbert 1997, Surface Simplification Using Quadric Error Metrics;
Dey et al. 1999, Topology preserving edge contraction (when the topology stays).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import face_cross
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["MOST_NEIGHBOURS", "Rings", "collapse", "faces_of", "insert", "quadrics_of", "rings_of"]

MOST_NEIGHBOURS = 48
"""Of a vertex, while others go."""

Rings = NDArray[np.int32]


def rings_of(faces: Index, count: int, apex: int) -> tuple[Rings, Index]:
    """Return the vertices around each, (V, MOST_NEIGHBOURS) int32, and their number, (V,) int64.

    Raises
    ------
    ValueError
        The surface is not closed, no manifold, or a vertex has too many neighbours.
    """
    rings, degrees = np.full((count, MOST_NEIGHBOURS), -1, np.int32), np.zeros(count, np.int64)
    corners = np.concatenate([faces[:, [0, 1, 2]], faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]])
    corners = corners[np.argsort(corners[:, 0], kind="stable")]
    begin = np.searchsorted(corners[:, 0], np.arange(count + 1))
    if not _order_rings(corners, begin, apex, rings, degrees):
        raise ValueError("The surface is not closed, no manifold, or a vertex has too many neighbours.")
    return rings, degrees


def faces_of(rings: Rings, degrees: Index, used: Index, apex: int) -> Index:
    """Return the triangles (F, 3) between used vertices, but for those of the apex."""
    positions, number = np.arange(rings.shape[1]), degrees[used][:, None]
    after = np.take_along_axis(rings[used], (positions + 1) % np.maximum(number, 1), 1)
    within = positions < number
    faces = np.stack([np.repeat(used, degrees[used]), rings[used][within], after[within]], 1)
    first = (faces[:, 0] < faces[:, 1]) & (faces[:, 0] < faces[:, 2])
    return np.asarray(faces[first & (faces != apex).all(1)], np.int64)


def quadrics_of(verts: Floats, faces: Index) -> Floats:
    """Return the sums (V, 10) of the squared distances to the planes of the triangles around, by area."""
    cross = face_cross(verts, faces)
    twice = np.maximum(np.linalg.norm(cross, axis=1), 1e-300)
    normals = cross / twice[:, None]
    planes = np.concatenate([normals, -(normals * verts[faces[:, 0]]).sum(1, keepdims=True)], 1)
    rows, columns = np.triu_indices(4)
    terms = planes[:, rows] * planes[:, columns] * twice[:, None]
    return np.stack([np.bincount(faces.ravel(), np.repeat(terms[:, i], 3), len(verts)) for i in range(10)], 1)


@kernel
def _order_rings(corners: Index, begin: Index, apex: int, rings: Rings, degrees: Index) -> bool:
    """Set the rings by the corners (vertex, next, last); return whether all close."""
    for v in range(len(degrees)):
        number = begin[v + 1] - begin[v]
        degrees[v] = number
        if v == apex or number == 0:
            continue
        if number > rings.shape[1]:
            return False
        at = corners[begin[v], 1]
        for index in range(number):
            rings[v, index] = at
            after = -1
            for row in range(begin[v], begin[v + 1]):
                if corners[row, 1] == at:
                    after = corners[row, 2]
            at = after
        if at != rings[v, 0]:
            return False
    return True


@kernel
def _cost(quadrics: Floats, positions: Floats, u: int, v: int, degree: int) -> float:
    """Return what it costs to move u to v, which then has so many neighbours."""
    position = (positions[v, 0], positions[v, 1], positions[v, 2], 1.0)
    error, at, length = 0.0, 0, 0.0
    for i in range(4):
        for j in range(i, 4):
            value = (quadrics[u, at] + quadrics[v, at]) * position[i] * position[j]
            error += value if i == j else 2 * value
            at += 1
    for i in range(3):
        length += (positions[u, i] - positions[v, i]) ** 2
    return (max(error, 0.0) + 1e-5 * length * length + 1e-16) * (1 + 0.02 * max(degree - 6, 0) ** 2)


@kernel
def _index_in(u: int, v: int, rings: Rings, degrees: Index) -> int:
    """Return the index of v in the ring of u, or -1."""
    for i in range(degrees[u]):
        if rings[u, i] == v:
            return i
    return -1


@kernel
def _keeps_circle(u: int, v: int, rings: Rings, degrees: Index, bound: Flags, apex: int) -> bool:
    """Return whether the bound vertices stay one circle without chords if u goes to v, which is one of them."""
    n = degrees[u]
    if bound[u] and n < 4:
        return False
    if not bound[u] and n == 3 and bound[rings[u, 0]] and bound[rings[u, 1]] and bound[rings[u, 2]]:
        return False
    at = _index_in(u, apex, rings, degrees) if bound[u] else -1
    for i in range(n):
        w = rings[u, i]
        if w == v or not bound[w] or _index_in(v, w, rings, degrees) >= 0:
            continue
        beside = at >= 0 and ((at + 1) % n == i or (i + 1) % n == at)
        if not beside:
            return False
    return True


@kernel
def _may_collapse(u: int, v: int, rings: Rings, degrees: Index, bound: Flags, apex: int) -> bool:
    """Return whether u may go to v."""
    if u == apex or v == apex or (bound[u] and not bound[v]) or degrees[u] + degrees[v] - 4 > rings.shape[1]:
        return False
    n, at = degrees[u], _index_in(u, v, rings, degrees)
    for step in (1, n - 1):
        w = rings[u, (at + step) % n]
        if w != apex and degrees[w] <= 3:
            return False
    common = 0
    for i in range(n):
        common += _index_in(v, rings[u, i], rings, degrees) >= 0
    return common == 2 and (not bound[v] or _keeps_circle(u, v, rings, degrees, bound, apex))


@kernel
def _cheapest(
    u: int, positions: Floats, quadrics: Floats, rings: Rings, degrees: Index, bound: Flags, apex: int, room: Floats
) -> tuple[float, int]:
    """Return the least cost of a collapse of u, and where to; -1 if there is none. `room` (MOST_NEIGHBOURS,)."""
    for i in range(degrees[u]):
        v = rings[u, i]
        away = v == apex or (bound[u] and not bound[v])
        room[i] = np.inf if away else _cost(quadrics, positions, u, v, degrees[u] + degrees[v] - 4)
    while True:
        least, at = np.inf, -1
        for i in range(degrees[u]):
            if room[i] < least:
                least, at = room[i], i
        if at < 0:
            return np.inf, -1
        if _may_collapse(u, rings[u, at], rings, degrees, bound, apex):
            return least, rings[u, at]
        room[at] = np.inf


@kernel
def _move(u: int, cost: float, heap: Index, slot_of: Index, costs: Floats) -> None:
    """Give a vertex a cost in the heap (V,): the cheapest first, then the least; `slot_of` (V,): where each is."""
    costs[u], at = cost, slot_of[u]
    while at > 0:
        above = heap[(at - 1) // 2]
        if costs[above] < cost or (costs[above] == cost and above < u):
            break
        heap[at], slot_of[above] = above, at
        at = (at - 1) // 2
    while 2 * at + 1 < len(heap):
        down = 2 * at + 1
        below = heap[down]
        if down + 1 < len(heap):
            other = heap[down + 1]
            if costs[other] < costs[below] or (costs[other] == costs[below] and other < below):
                down, below = down + 1, other
        if cost < costs[below] or (cost == costs[below] and u < below):
            break
        heap[at], slot_of[below] = below, at
        at = down
    heap[at], slot_of[u] = u, at


@kernel
def collapse(
    positions: Floats, quadrics: Floats, rings: Rings, degrees: Index, bound: Flags, apex: int, order: Index
) -> int:
    """Collapse all that may be; set (vertex, where it went) in `order` (V, 2) and return their number."""
    count = len(degrees)
    best, alive, circle = np.full(count, -1), degrees > 0, bound.sum()
    heap, slot_of, costs = np.arange(count), np.arange(count), np.full(count, np.inf)
    room = np.zeros(rings.shape[1])
    for u in range(count):
        if u != apex and alive[u]:
            cost, best[u] = _cheapest(u, positions, quadrics, rings, degrees, bound, apex, room)
            _move(u, cost, heap, slot_of, costs)
    removed = 0
    path = np.zeros(2 * rings.shape[1], np.int32)
    while costs[heap[0]] < np.inf:
        u = heap[0]
        v = best[u]
        if bound[u] and circle <= 3:
            _move(u, np.inf, heap, slot_of, costs)
            continue
        if not _may_collapse(u, v, rings, degrees, bound, apex):
            cost, best[u] = _cheapest(u, positions, quadrics, rings, degrees, bound, apex, room)
            _move(u, cost, heap, slot_of, costs)
            continue
        _remove(u, v, rings, degrees, apex, path)
        alive[u] = False
        _move(u, np.inf, heap, slot_of, costs)
        circle -= bound[u]
        order[removed, 0], order[removed, 1] = u, v
        removed += 1
        quadrics[v] += quadrics[u]
        for at in range(-1, degrees[v]):
            w = v if at < 0 else rings[v, at]
            if w != apex:
                cost, best[w] = _cheapest(w, positions, quadrics, rings, degrees, bound, apex, room)
                _move(w, cost, heap, slot_of, costs)
    return removed


@kernel
def _turn(u: int, first: int, rings: Rings, degrees: Index, path: Rings) -> None:
    """Let the ring of u begin with one of its vertices."""
    n, at = degrees[u], _index_in(u, first, rings, degrees)
    for i in range(n):
        path[i] = rings[u, (at + i) % n]
    for i in range(n):
        rings[u, i] = path[i]


@kernel
def _remove(u: int, v: int, rings: Rings, degrees: Index, apex: int, path: Rings) -> None:
    """Move u to v in the rings around; the ring of u, which then begins with v, stays."""
    _turn(u, v, rings, degrees, path)
    _turn(v, u, rings, degrees, path)
    n, m = degrees[u], degrees[v]
    # The ring of u: v, a, r2, ..., b; that of v: u, b, ..., a. In place of u come r2 and all before b.
    for i in range(m):
        path[i] = rings[v, i]
    for i in range(2, n - 1):
        rings[v, i - 2] = rings[u, i]
    for i in range(1, m):
        rings[v, n + i - 4] = path[i]
    degrees[v] = m + n - 4
    for i in range(1, n):
        w = rings[u, i]
        if w == apex:
            continue
        at = _index_in(w, u, rings, degrees)
        if i in (1, n - 1):
            for j in range(at, degrees[w] - 1):
                rings[w, j] = rings[w, j + 1]
            degrees[w] -= 1
        else:
            rings[w, at] = v


@kernel
def insert(u: int, v: int, rings: Rings, degrees: Index, apex: int, path: Rings) -> None:
    """Undo the last collapse, of u to v; `path` (2 MOST_NEIGHBOURS,) int32 is room to work in."""
    n = degrees[u]
    _turn(v, rings[u, 1], rings, degrees, path)
    # The ring of v: a, r2, ..., b, ...; of u: v, a, r2, ..., b.
    m = degrees[v]
    for i in range(m):
        path[i] = rings[v, i]
    rings[v, 1] = u
    for i in range(n - 2, m):
        rings[v, i - n + 4] = path[i]
    degrees[v] = m - n + 4
    for i in range(1, n):
        w = rings[u, i]
        if w == apex:
            continue
        at = _index_in(w, v, rings, degrees)
        if i in (1, n - 1):
            before = at if i == 1 else at + 1  # around a: u, v; around b: v, u
            for j in range(degrees[w], before, -1):
                rings[w, j] = rings[w, j - 1]
            rings[w, before] = u
            degrees[w] += 1
        else:
            rings[w, at] = u
