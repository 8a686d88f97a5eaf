"""Map a surface of genus 0 to the unit sphere, one to one, with a share of the sphere for every part of it.

Half-edge collapses take the surface to a tetrahedron, which is put on the sphere. Undone one after the other, each
puts its vertex into the kernel of the spherical polygon around it, so that all triangles stay counter-clockwise; then
the vertex and those around it move to lessen the stretch from the sphere to the surface ::

    sum over triangles   A (|J|^2) / 2  =  A (d_a |bc|^2 + d_b |ca|^2 + d_c |ab|^2) / (2 det(a, b, c)^2)

with a, b, c the corners on the sphere, d_a = (b - a) . (c - a), and the area A and the lengths on the surface; J is
the map's derivative, and det(a, b, c) stands for twice the area on the sphere, so that the energy is infinite where a
triangle would turn over. From time to time all vertices move. Lengths on the surface are those of places and weighted
normals side by side: what is thin, and so turns much, gets more of the sphere.

Half of a mirrored surface, a disc, goes to the half x >= 0 of the sphere: an apex at (-1, 0, 0) closes it, and the
vertices of its boundary stay in the plane x = 0.

Sources: Praun and Hoppe 2003, Spherical Parametrization and Remeshing, sections 3 and 4; Sander et al. 2001, Texture
Mapping Progressive Meshes, section 3 (stretch); Garland and Heckbert 1997, Surface Simplification Using Quadric Error
Metrics (the order of the collapses).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.kernels import kernel
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["SphereMap", "sphere_map"]

_RING = 48
"""Most neighbours of a vertex while others are collapsed."""
_GROWTH, _SWEEPS, _LAST_SWEEPS = 1.5, 3, 6
"""By how much the number of vertices grows between sweeps over all of them."""
_NORMALS = 0.06
"""Length of a unit normal beside places, a share of the diagonal."""
_LEAST = 1e-3
"""Length that is added to all edges, a share of the diagonal."""


@dataclass(frozen=True)
class SphereMap:
    """Vertices of a surface on the unit sphere.

    `directions` (V, 3) float64, `faces` (F, 3) int64: all counter-clockwise seen from outside; `origin` (V,) int64: the
    vertex of the surface.
    """

    directions: Floats
    faces: Index
    origin: Index


def sphere_map(verts: Floats, faces: Index, count: int, *, mirrored: bool) -> SphereMap:
    """Map `count` vertices of a closed surface, or of the half of a mirrored one, to the sphere.

    Raises
    ------
    ValueError
        The surface is not of genus 0, or with a mirror no disc.
    """
    total = len(verts) + mirrored
    edge = _boundary(faces, len(verts)) if mirrored else np.zeros(0, np.int64)
    closed = faces
    if mirrored:
        closed = np.concatenate([faces, np.stack([edge[:, 1], edge[:, 0], np.full(len(edge), len(verts))], 1)])
    bound = np.zeros(total, bool)
    bound[edge.ravel()] = True
    apex = len(verts) if mirrored else -1
    rings, degrees = _rings(closed, total, apex)
    low, high = verts.min(0), verts.max(0)
    diagonal = float(np.linalg.norm(high - low))
    places = np.zeros((total, 3))
    places[: len(verts)] = (verts - low) / diagonal
    normals = _vertex_normals(places, faces)
    order = np.full((total, 2), -1)
    removed = _collapse(places, _quadrics(places, faces), rings, degrees, bound, apex, order)
    features = np.hstack([places, _NORMALS * normals])
    directions = np.zeros((total, 3))
    alive = np.ones(total, bool)
    alive[order[:removed, 0]] = False
    _place_base(directions, rings, degrees, alive, bound, apex)
    kept = max(removed - max(count - int(alive.sum()), 0), 0)
    _grow(features, directions, rings, degrees, bound, apex, alive, order, removed, kept)
    return _result(directions, rings, degrees, alive, apex)


def _boundary(faces: Index, count: int) -> Index:
    """Return the directed edges (B, 2) of one triangle alone."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    keys, opposite = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    return np.asarray(edges[~np.isin(keys, opposite)])


def _vertex_normals(verts: Floats, faces: Index) -> Floats:
    """Return unit normals (V, 3)."""
    a, b, c = verts[faces].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    normals = np.stack([np.bincount(faces.ravel(), np.repeat(cross[:, i], 3), len(verts)) for i in range(3)], 1)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))


def _quadrics(verts: Floats, faces: Index) -> Floats:
    """Return the sums (V, 10) of the squared distances to the planes of the triangles around, by area."""
    a, b, c = verts[faces].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    twice = np.maximum(np.linalg.norm(cross, axis=1), 1e-300)
    n = cross / twice[:, None]
    plane = np.concatenate([n, -(n * a).sum(1, keepdims=True)], 1)
    rows, columns = np.triu_indices(4)
    terms = plane[:, rows] * plane[:, columns] * twice[:, None]
    return np.stack([np.bincount(faces.ravel(), np.repeat(terms[:, i], 3), len(verts)) for i in range(10)], 1)


def _rings(faces: Index, count: int, apex: int) -> tuple[NDArray[np.int32], Index]:
    """Return the vertices around each, counter-clockwise, (V, _RING) int32, and their number (V,)."""
    rings, degrees = np.full((count, _RING), -1, np.int32), np.zeros(count, np.int64)
    corner = np.concatenate([faces[:, [0, 1, 2]], faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]])
    corner = corner[np.argsort(corner[:, 0], kind="stable")]
    begin = np.searchsorted(corner[:, 0], np.arange(count + 1))
    if not _order_rings(corner, begin, apex, rings, degrees):
        raise ValueError("The surface is no manifold, or a vertex has too many neighbours.")
    return rings, degrees


@kernel
def _order_rings(corner: Index, begin: Index, apex: int, rings: NDArray[np.int32], degrees: Index) -> bool:
    """Set the rings by the corners (vertex, next, last); return whether all close."""
    for v in range(len(degrees)):
        number = begin[v + 1] - begin[v]
        degrees[v] = number
        if v == apex or number == 0:
            continue
        if number > rings.shape[1]:
            return False
        at = corner[begin[v], 1]
        for place in range(number):
            rings[v, place] = at
            after = -1
            for row in range(begin[v], begin[v + 1]):
                if corner[row, 1] == at:
                    after = corner[row, 2]
            at = after
        if at != rings[v, 0]:
            return False
    return True


@kernel
def _cost(quadrics: Floats, places: Floats, u: int, v: int, degree: int) -> float:
    """Return what it costs to move u to v: the error of the quadrics, and a little of the length."""
    q0, q1, q2 = places[v, 0], places[v, 1], places[v, 2]
    h = (q0, q1, q2, 1.0)
    error, at, length = 0.0, 0, 0.0
    for i in range(4):
        for j in range(i, 4):
            value = (quadrics[u, at] + quadrics[v, at]) * h[i] * h[j]
            error += value if i == j else 2 * value
            at += 1
    for i in range(3):
        length += (places[u, i] - places[v, i]) ** 2
    return (max(error, 0.0) + 1e-5 * length * length + 1e-16) * (1 + 0.02 * max(degree - 6, 0) ** 2)


@kernel
def _may_collapse(u: int, v: int, rings: NDArray[np.int32], degrees: Index, bound: Flags, apex: int) -> bool:
    """Return whether u may move to v: both share two neighbours, and the boundary stays one circle without chords."""
    if u == apex or v == apex or (bound[u] and not bound[v]):
        return False
    if degrees[u] + degrees[v] - 4 > rings.shape[1]:
        return False
    common = 0
    for i in range(degrees[u]):
        w = rings[u, i]
        if w == v:
            after, before = rings[u, (i + 1) % degrees[u]], rings[u, i - 1 if i else degrees[u] - 1]
            if (w != apex and after != apex and degrees[after] <= 3) or (before != apex and degrees[before] <= 3):
                return False
        for j in range(degrees[v]):
            if rings[v, j] == w:
                common += 1
    if common != 2:
        return False
    if bound[v]:
        apexes = False
        for i in range(degrees[u]):
            apexes |= rings[u, i] == apex
        for i in range(degrees[u]):
            w = rings[u, i]
            if w == v or not bound[w]:
                continue
            near = False
            for j in range(degrees[v]):
                near |= rings[v, j] == w
            if bound[u]:
                # The other neighbour on the circle may become one of v; any other would make a chord.
                on_circle = False
                for j in range(degrees[u]):
                    if rings[u, j] == apex:
                        on_circle = rings[u, (j + 1) % degrees[u]] == w or rings[u, j - 1 if j else degrees[u] - 1] == w
                if not on_circle and not near:
                    return False
            elif not near:
                return False
        if not bound[u] and degrees[u] == 3 and bound[rings[u, 0]] and bound[rings[u, 1]] and bound[rings[u, 2]]:
            return False
        if bound[u] and degrees[u] < 4:
            return False
    return True


@kernel
def _collapse(
    places: Floats,
    quadrics: Floats,
    rings: NDArray[np.int32],
    degrees: Index,
    bound: Flags,
    apex: int,
    order: Index,
) -> int:
    """Collapse all that may be; set (vertex, where it went) in order and return their number."""
    count = len(degrees)
    stamps = np.zeros(count, np.int64)
    alive = degrees > 0
    circle = 0
    for v in range(count):
        circle += bound[v]
    best = np.full(count, -1)
    queue = [(0.0, 0, np.int64(0))]
    heapq.heappop(queue)
    for u in range(count):
        if u != apex and alive[u]:
            cost, v = _cheapest(u, places, quadrics, rings, degrees, bound, apex)
            best[u] = v
            if v >= 0:
                heapq.heappush(queue, (cost, u, stamps[u]))
    removed = 0
    path = np.zeros(2 * rings.shape[1], np.int32)
    while len(queue) > 0:
        _, u, stamp = heapq.heappop(queue)
        if not alive[u] or stamp != stamps[u]:
            continue
        v = best[u]
        if not _may_collapse(u, v, rings, degrees, bound, apex) or (bound[u] and circle <= 3):
            stamps[u] += 1
            cost, v = _cheapest(u, places, quadrics, rings, degrees, bound, apex)
            best[u] = v
            if v >= 0 and not (bound[u] and circle <= 3):
                heapq.heappush(queue, (cost, u, stamps[u]))
            continue
        _remove(u, v, rings, degrees, apex, path)
        alive[u] = False
        circle -= bound[u]
        order[removed, 0], order[removed, 1] = u, v
        removed += 1
        for i in range(10):
            quadrics[v, i] += quadrics[u, i]
        for at in range(-1, degrees[v]):
            w = v if at < 0 else rings[v, at]
            if w == apex:
                continue
            stamps[w] += 1
            cost, goal = _cheapest(w, places, quadrics, rings, degrees, bound, apex)
            best[w] = goal
            if goal >= 0:
                heapq.heappush(queue, (cost, w, stamps[w]))
    return removed


@kernel
def _cheapest(
    u: int, places: Floats, quadrics: Floats, rings: NDArray[np.int32], degrees: Index, bound: Flags, apex: int
) -> tuple[float, int]:
    """Return the least cost of a collapse of u, and where to; -1 if there is none."""
    least, goal = np.inf, -1
    for i in range(degrees[u]):
        v = rings[u, i]
        if v == apex or (bound[u] and not bound[v]):
            continue
        cost = _cost(quadrics, places, u, v, degrees[u] + degrees[v] - 4)
        if cost < least and _may_collapse(u, v, rings, degrees, bound, apex):
            least, goal = cost, v
    return least, goal


@kernel
def _turn_ring(u: int, v: int, rings: NDArray[np.int32], degrees: Index, path: NDArray[np.int32]) -> None:
    """Let the ring of u begin with v."""
    n = degrees[u]
    first = 0
    for i in range(n):
        if rings[u, i] == v:
            first = i
    for i in range(n):
        path[i] = rings[u, (first + i) % n]
    for i in range(n):
        rings[u, i] = path[i]


@kernel
def _remove(u: int, v: int, rings: NDArray[np.int32], degrees: Index, apex: int, path: NDArray[np.int32]) -> None:
    """Move u to v in the rings around; the ring of u, which then begins with v, stays."""
    _turn_ring(u, v, rings, degrees, path)
    _turn_ring(v, u, rings, degrees, path)
    n, m = degrees[u], degrees[v]
    # v's ring: u, b, ..., a; u's ring: v, a, r2, ..., b. In place of u come r2, ..., before b.
    for i in range(m):
        path[i] = rings[v, i]
    for i in range(2, n - 1):
        rings[v, i - 2] = rings[u, i]
    for i in range(1, m):
        rings[v, n - 3 + i - 1] = path[i]
    degrees[v] = m + n - 4
    for i in range(1, n):
        w = rings[u, i]
        if w == apex:
            continue
        at = 0
        for j in range(degrees[w]):
            if rings[w, j] == u:
                at = j
        if i == 1 or i == n - 1:
            for j in range(at, degrees[w] - 1):
                rings[w, j] = rings[w, j + 1]
            degrees[w] -= 1
        else:
            rings[w, at] = v


@kernel
def _insert(u: int, v: int, rings: NDArray[np.int32], degrees: Index, apex: int, path: NDArray[np.int32]) -> None:
    """Undo `_remove`."""
    n = degrees[u]
    _turn_ring(v, rings[u, 1], rings, degrees, path)
    # v's ring: a, r2, ..., b, ...
    m = degrees[v]
    for i in range(m):
        path[i] = rings[v, i]
    rings[v, 1] = u
    for i in range(n - 2, m):
        rings[v, i - (n - 2) + 2] = path[i]
    degrees[v] = m - n + 4
    for i in range(1, n):
        w = rings[u, i]
        if w == apex:
            continue
        at = 0
        for j in range(degrees[w]):
            if rings[w, j] == v:
                at = j
        if i == 1:  # around a: u, v
            for j in range(degrees[w], at, -1):
                rings[w, j] = rings[w, j - 1]
            rings[w, at] = u
            degrees[w] += 1
        elif i == n - 1:  # around b: v, u
            for j in range(degrees[w], at + 1, -1):
                rings[w, j] = rings[w, j - 1]
            rings[w, at + 1] = u
            degrees[w] += 1
        else:
            rings[w, at] = u


def _place_base(
    directions: Floats, rings: NDArray[np.int32], degrees: Index, alive: Flags, bound: Flags, apex: int
) -> None:
    """Put the base on the sphere: a tetrahedron, or the triangle of the boundary, the apex and one vertex."""
    rows = np.flatnonzero(alive & (degrees > 0))
    if len(rows) != (4 if apex < 0 else 5):
        raise ValueError(f"The surface is not of genus 0, or no disc: {len(rows)} vertices are left.")
    third = 2 * np.pi / 3
    if apex < 0:
        first = rows[0]
        directions[first] = [0, 1, 0]
        ring = rings[first, :3]
        height, turns = -1 / 3, np.arange(3) * third
        directions[ring] = np.stack([np.sin(turns), np.full(3, 0.0), np.cos(turns)], 1) * np.sqrt(8 / 9) + [
            0,
            height,
            0,
        ]
        return
    inner = int(rows[~bound[rows] & (rows != apex)][0])
    directions[apex], directions[inner] = [-1, 0, 0], [1, 0, 0]
    turns = np.arange(3) * third
    directions[rings[inner, :3]] = np.stack([np.zeros(3), np.cos(turns), np.sin(turns)], 1)


@kernel
def _det(a: Floats, b: Floats, c: Floats) -> float:
    det: float = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return det


@kernel
def _squared(a: Floats, b: Floats) -> float:
    total = 0.0
    for i in range(len(a)):
        total += (a[i] - b[i]) ** 2
    return total


@kernel
def _weights(features: Floats, u: int, v: int, w: int) -> tuple[float, float, float, float]:
    """Return the area of a triangle on the surface, and the squares of its edges: opposite u, v, w."""
    least = _LEAST * _LEAST
    p = _squared(features[v], features[w]) + least
    q = _squared(features[w], features[u]) + least
    r = _squared(features[u], features[v]) + least
    square = max(4 * q * r - (q + r - p) ** 2, least * (p + q + r))
    return np.sqrt(square) / 4, p, q, r


@kernel
def _energy(
    u: int,
    s: Floats,
    features: Floats,
    directions: Floats,
    rings: NDArray[np.int32],
    degrees: Index,
    apex: int,
    gradient: Floats,
    hessian: Floats,
    derived: bool,
) -> float:
    """Return the energy of the triangles around u at s; set its derivatives there."""
    total = 0.0
    n = degrees[u]
    if derived:
        gradient[:] = 0
        hessian[:] = 0
    for i in range(n):
        v, w = rings[u, i], rings[u, i + 1 if i + 1 < n else 0]
        b, c = directions[v], directions[w]
        det = _det(s, b, c)
        if v == apex or w == apex:
            if det <= 1e-9:
                return np.inf
            continue
        if det <= 1e-13:
            return np.inf
        area, p, q, r = _weights(features, u, v, w)
        da, db, dc = 0.0, 0.0, 0.0
        for j in range(3):
            da += (b[j] - s[j]) * (c[j] - s[j])
            db += (s[j] - b[j]) * (c[j] - b[j])
            dc += (s[j] - c[j]) * (b[j] - c[j])
        value = da * p + db * q + dc * r
        inverse = 1 / (det * det)
        total += 0.5 * area * value * inverse
        if not derived:
            continue
        x = b[1] * c[2] - b[2] * c[1]
        y = b[2] * c[0] - b[0] * c[2]
        z = b[0] * c[1] - b[1] * c[0]
        g = (x, y, z)
        for j in range(3):
            dj = p * (2 * s[j] - b[j] - c[j]) + (q - r) * (c[j] - b[j])
            gradient[j] += 0.5 * area * inverse * (dj - 2 * value * g[j] / det)
            for k in range(3):
                dk = p * (2 * s[k] - b[k] - c[k]) + (q - r) * (c[k] - b[k])
                term = -2 * (dj * g[k] + dk * g[j]) / det + 6 * value * g[j] * g[k] * inverse
                if j == k:
                    term += 2 * p
                hessian[j, k] += 0.5 * area * inverse * term
    return total


@kernel
def _move(
    u: int,
    features: Floats,
    directions: Floats,
    rings: NDArray[np.int32],
    degrees: Index,
    bound: Flags,
    apex: int,
    gradient: Floats,
    hessian: Floats,
) -> None:
    """Take one step of Newton's on the sphere, shortened until the energy falls."""
    s = directions[u].copy()
    before = _energy(u, s, features, directions, rings, degrees, apex, gradient, hessian, True)
    radial = s[0] * gradient[0] + s[1] * gradient[1] + s[2] * gradient[2]
    first, second = np.zeros(3), np.zeros(3)
    if bound[u]:
        first[1], first[2] = -s[2], s[1]
    else:
        if abs(s[0]) < 0.6:
            first[0] = 1
        else:
            first[1] = 1
        along = first[0] * s[0] + first[1] * s[1] + first[2] * s[2]
        first -= along * s
        first /= np.sqrt(first[0] ** 2 + first[1] ** 2 + first[2] ** 2)
        second[0] = s[1] * first[2] - s[2] * first[1]
        second[1] = s[2] * first[0] - s[0] * first[2]
        second[2] = s[0] * first[1] - s[1] * first[0]
    g1, g2, h11, h12, h22 = 0.0, 0.0, -radial, 0.0, -radial
    for j in range(3):
        g1 += first[j] * gradient[j]
        g2 += second[j] * gradient[j]
        for k in range(3):
            h11 += first[j] * hessian[j, k] * first[k]
            h12 += first[j] * hessian[j, k] * second[k]
            h22 += second[j] * hessian[j, k] * second[k]
    if bound[u]:
        x1, x2 = -g1 / max(abs(h11), 1e-300), 0.0
    else:
        middle, half = (h11 + h22) / 2, np.sqrt(((h11 - h22) / 2) ** 2 + h12**2)
        shift = max(0.0, 0.05 * (abs(middle) + half) - (middle - half))
        h11 += shift
        h22 += shift
        scale = max(h11 * h22 - h12 * h12, 1e-300)
        x1, x2 = -(h22 * g1 - h12 * g2) / scale, -(h11 * g2 - h12 * g1) / scale
    size = np.sqrt(x1 * x1 + x2 * x2)
    if size > 0.5:
        x1, x2 = 0.5 * x1 / size, 0.5 * x2 / size
    trial = np.empty(3)
    for _ in range(7):
        length = 0.0
        for j in range(3):
            trial[j] = s[j] + x1 * first[j] + x2 * second[j]
            length += trial[j] ** 2
        trial /= np.sqrt(length)
        if _energy(u, trial, features, directions, rings, degrees, apex, gradient, hessian, False) < before:
            directions[u] = trial
            return
        x1, x2 = 0.4 * x1, 0.4 * x2


@kernel
def _bisector(u: int, v: int, directions: Floats, rings: NDArray[np.int32], n: int, goal: Floats) -> None:
    """Set a place in the middle of the angle at v that the fan in place of u spans."""
    at = directions[v]
    one, other = np.zeros(3), np.zeros(3)
    turn, last, reach = 0.0, 0.0, 1.0
    for i in range(1, n):
        w = directions[rings[u, i]]
        along = at[0] * w[0] + at[1] * w[1] + at[2] * w[2]
        if i == 1:
            one[:] = w - along * at
            one /= np.sqrt(one[0] ** 2 + one[1] ** 2 + one[2] ** 2)
            other[0] = at[1] * one[2] - at[2] * one[1]
            other[1] = at[2] * one[0] - at[0] * one[2]
            other[2] = at[0] * one[1] - at[1] * one[0]
        else:
            x = one[0] * w[0] + one[1] * w[1] + one[2] * w[2]
            y = other[0] * w[0] + other[1] * w[1] + other[2] * w[2]
            angle = np.arctan2(y, x)
            turn += (angle - last) % (2 * np.pi)
            last = angle
        reach = min(reach, np.sqrt(max(1 - along * along, 0.0)))
    goal[:] = at + reach * (np.cos(turn / 2) * one + np.sin(turn / 2) * other)


@kernel
def _start(
    u: int,
    v: int,
    features: Floats,
    directions: Floats,
    rings: NDArray[np.int32],
    degrees: Index,
    bound: Flags,
    apex: int,
    gradient: Floats,
    hessian: Floats,
) -> bool:
    """Put u where its triangles are counter-clockwise: on the way from v to the middle, or into the fan around v."""
    n, at = degrees[u], directions[v]
    best, kept, trial, goal = np.inf, np.zeros(3), np.zeros(3), np.zeros(3)
    for way in range(2):
        if bound[u]:
            for i in range(n):
                w = rings[u, i]
                if w != v and w != apex and (rings[u, (i + 1) % n] == apex or rings[u, i - 1 if i else n - 1] == apex):
                    goal[:] = directions[w]
        elif way == 0:
            goal[:] = 0
            for i in range(n):
                goal += directions[rings[u, i]]
        else:
            _bisector(u, v, directions, rings, n, goal)
        goal /= max(np.sqrt(goal[0] ** 2 + goal[1] ** 2 + goal[2] ** 2), 1e-9)
        share = 1.0 if way == 0 and not bound[u] else 0.6
        for _ in range(40):
            trial[:] = at + share * (goal - at)
            trial /= np.sqrt(trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2)
            energy = _energy(u, trial, features, directions, rings, degrees, apex, gradient, hessian, False)
            if energy < best:
                best = energy
                kept[:] = trial
            elif energy < np.inf:
                break
            share *= 0.6
        if bound[u]:
            break
    directions[u] = kept
    return best < np.inf


@kernel
def _grow(
    features: Floats,
    directions: Floats,
    rings: NDArray[np.int32],
    degrees: Index,
    bound: Flags,
    apex: int,
    alive: Flags,
    order: Index,
    removed: int,
    kept: int,
) -> int:
    """Undo the collapses from the last to number `kept`."""
    gradient, hessian = np.zeros(3), np.zeros((3, 3))
    path = np.zeros(2 * rings.shape[1], np.int32)
    number = 0
    for v in range(len(alive)):
        number += alive[v]
    swept, failed = number, 0
    for step in range(removed - 1, kept - 1, -1):
        u, v = order[step, 0], order[step, 1]
        found = _start(u, v, features, directions, rings, degrees, bound, apex, gradient, hessian)
        if not found:
            failed += 1
            break
        _insert(u, v, rings, degrees, apex, path)
        alive[u] = True
        number += 1
        for _ in range(2):
            _move(u, features, directions, rings, degrees, bound, apex, gradient, hessian)
        for i in range(degrees[u]):
            w = rings[u, i]
            if w != apex:
                _move(w, features, directions, rings, degrees, bound, apex, gradient, hessian)
        if number >= _GROWTH * swept or step == kept:
            swept = number
            for _ in range(_LAST_SWEEPS if step == kept else _SWEEPS):
                for w in range(len(alive)):
                    if alive[w] and w != apex and degrees[w] > 0:
                        _move(w, features, directions, rings, degrees, bound, apex, gradient, hessian)
    return failed


def _result(directions: Floats, rings: NDArray[np.int32], degrees: Index, alive: Flags, apex: int) -> SphereMap:
    """Return what is on the sphere, without the apex."""
    used = np.flatnonzero(alive & (degrees > 0) & (np.arange(len(alive)) != apex))
    places = np.arange(_RING)
    own = np.repeat(used, degrees[used])
    ring, n = rings[used], degrees[used][:, None]
    after = np.take_along_axis(ring, (places + 1) % np.maximum(n, 1), 1)
    within = places < n
    faces = np.stack([own, ring[within], after[within]], 1)
    faces = faces[(faces[:, 0] < faces[:, 1]) & (faces[:, 0] < faces[:, 2]) & (faces != apex).all(1)]
    number = np.full(len(alive), -1)
    number[used] = np.arange(len(used))
    return SphereMap(directions[used], number[faces], used)
