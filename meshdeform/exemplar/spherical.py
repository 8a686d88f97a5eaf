"""Map a surface of genus 0 to the unit sphere, one to one, with a share of the sphere for every part of it.

Collapses take the surface to a tetrahedron (`rings.py`), which is put on the sphere. Undone one after the other, each
puts its vertex into the kernel of the spherical polygon around it, so that all triangles stay counter-clockwise; then
the vertex and those around it move, and from time to time all do, to lessen ::

    sum over triangles   A (s1 s2) (s1/s2 + s2/s1)^k   ~   A^(2-k) S^k det(a, b, c)^-(k+1),     k = 5/2
    S = d_a |bc|^2 + d_b |ca|^2 + d_c |ab|^2,     d_a = (b - a) . (c - a)

with the singular values s1, s2 of the map from the sphere to the surface, the corners a, b, c on the sphere, and the
area A and the lengths on the surface; det(a, b, c) stands for twice the area on the sphere, so that the energy is
infinite where a triangle would turn over. With k = 1 it is the stretch of Sander et al., which gives all parts of a
surface alike shares of the sphere, at the price of long thin triangles where limbs begin; a greater k makes the map
more conformal.

A vertex has a mass: its area, times what it is curved more than a ball of about a third of the surface's size, so that
thin limbs and grooves get more of the sphere. A collapse adds the mass of its vertex to the other's; areas and squared
lengths of triangles grow as the masses of their corners exceed the areas there. So parts that are not there yet have
their share from the beginning.

Half of a mirrored surface, a disc, goes to the half x >= 0 of the sphere: an apex at (-1, 0, 0) closes it, and the
vertices of its boundary stay in the plane x = 0.

Sources: Praun and Hoppe 2003, Spherical Parametrization and Remeshing, sections 3 and 4; Sander et al. 2001, Texture
Mapping Progressive Meshes, section 3 (stretch); Hormann and Greiner 2000, MIPS: An Efficient Global Parametrization
Method (s1/s2 + s2/s1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from meshdeform.exemplar.rings import MOST_NEIGHBOURS, Rings, collapse, faces_of, insert, quadrics_of, rings_of
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import face_cross
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["SphereMap", "sphere_map"]

_CONFORMAL = 2.5
"""k; the square root in `_energy` is its part beyond 2."""
_GROWTH, _SWEEPS, _LAST_SWEEPS = 1.3, 12, 20
"""By how much the number of vertices grows between sweeps over all of them."""
_REFERENCE, _MOST, _SMOOTHINGS = 0.15, 16.0, 10
"""Radius of a ball whose curvature is not great, a share of the diagonal; most by which curvature raises a mass."""
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


class _Surface(NamedTuple):
    """What the vertices are on the surface: points (V, 3), a share of the diagonal; masses and areas around, (V,)."""

    positions: Floats
    masses: Floats
    areas: Floats


class _Sphere(NamedTuple):
    """Where they are on the sphere, (V, 3), their rings and degrees as in `rings.py`, and which (V,) are of a boundary.

    `apex`: the vertex that closes it, or -1.
    """

    directions: Floats
    rings: Rings
    degrees: Index
    bound: Flags
    apex: int


def sphere_map(verts: Floats, faces: Index, count: int, *, mirrored: bool) -> SphereMap:
    """Map `count` vertices of a closed surface, or of the half of a mirrored one, to the sphere.

    Raises
    ------
    ValueError
        The surface is not of genus 0, or with a mirror no disc.
    """
    total, apex = len(verts) + mirrored, len(verts) if mirrored else -1
    closed, bound = faces, np.zeros(total, bool)
    if mirrored:
        rim = _boundary(faces, len(verts))
        closed = np.concatenate([faces, np.stack([rim[:, 1], rim[:, 0], np.full(len(rim), apex)], 1)])
        bound[rim.ravel()] = True
    rings, degrees = rings_of(closed, total, apex)
    low, high = verts.min(0), verts.max(0)
    positions = np.zeros((total, 3))
    positions[: len(verts)] = (verts - low) / float(np.linalg.norm(high - low))
    order = np.full((total, 2), -1)
    removed = collapse(positions, quadrics_of(positions, faces), rings, degrees, bound, apex, order)
    alive = degrees > 0
    alive[order[:removed, 0]] = False
    surface = _Surface(positions, _masses(positions, faces), np.zeros(total))
    sphere = _Sphere(np.zeros((total, 3)), rings, degrees, bound, apex)
    _put_base(sphere, alive)
    kept = max(removed - max(count - int(alive.sum()), 0), 0)
    _grow(surface, sphere, alive, order[:removed], kept)
    used = np.flatnonzero(alive & (np.arange(total) != apex))
    number = np.full(total, -1)
    number[used] = np.arange(len(used))
    return SphereMap(sphere.directions[used], number[faces_of(rings, degrees, used, apex)], used)


def _boundary(faces: Index, count: int) -> Index:
    """Return the directed edges (B, 2) of one triangle alone."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    keys, opposite = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    ordered = np.sort(keys)
    found = ordered[np.minimum(np.searchsorted(ordered, opposite), len(ordered) - 1)]
    return np.asarray(edges[found != opposite])


def _masses(positions: Floats, faces: Index) -> Floats:
    """Return the masses (V,) of the vertices: their areas, more where the surface is curved."""
    count = len(positions)
    cross = face_cross(positions, faces)
    normals = np.stack([np.bincount(faces.ravel(), np.repeat(cross[:, i], 3), count) for i in range(3)], 1)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    graph = sparse.csr_matrix((np.ones(len(ends)), tuple(ends.T)), shape=(count, count))
    graph = graph + graph.T
    number = np.maximum(np.asarray(graph.sum(1)).ravel(), 1)
    sums = np.zeros((count, 2))
    for column, values in enumerate((normals, positions)):
        squares = np.square(values[ends[:, 0]] - values[ends[:, 1]]).sum(1)
        sums[:, column] = np.bincount(ends.ravel(), np.repeat(squares, 2), count)
    for _ in range(_SMOOTHINGS):
        sums = (sums + (graph @ sums) / number[:, None]) / 2
    curvature = np.sqrt(sums[:, 0] / np.maximum(sums[:, 1], 1e-300))
    areas = np.bincount(faces.ravel(), np.repeat(np.linalg.norm(cross, axis=1) / 2, 3), count)
    return np.asarray(areas * np.clip(_REFERENCE * curvature, 1, _MOST))


def _put_base(sphere: _Sphere, alive: Flags) -> None:
    """Put the base on the sphere: a tetrahedron, or the triangle of the boundary, the apex and one vertex."""
    directions, rings, apex = sphere.directions, sphere.rings, sphere.apex
    rows = np.flatnonzero(alive)
    if len(rows) != (4 if apex < 0 else 5):
        raise ValueError(f"The surface is not of genus 0, or no disc: {len(rows)} vertices are left.")
    turns = np.arange(3) * 2 * np.pi / 3
    cosine, sine = np.cos(turns), np.sin(turns)
    if apex < 0:
        directions[rows[0]] = [0, 1, 0]
        directions[rings[rows[0], :3]] = np.stack([sine, np.full(3, -(0.125**0.5)), cosine], 1) * (8 / 9) ** 0.5
    else:
        inner = int(rows[~sphere.bound[rows] & (rows != apex)][0])
        directions[apex], directions[inner] = [-1, 0, 0], [1, 0, 0]
        directions[rings[inner, :3]] = np.stack([np.zeros(3), cosine, sine], 1)


@kernel
def _det(a: Floats, b: Floats, c: Floats) -> float:
    det: float = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return det


@kernel
def _normalise(a: Floats) -> None:
    length = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    for i in range(3):
        a[i] /= max(length, 1e-300)


@kernel
def _measures(positions: Floats, u: int, v: int, w: int) -> tuple[float, float, float, float]:
    """Return the area of a triangle on the surface, and the squares of its edges: opposite u, v, w."""
    least = _LEAST * _LEAST
    p, q, r = least, least, least
    for i in range(3):
        p += (positions[v, i] - positions[w, i]) ** 2
        q += (positions[w, i] - positions[u, i]) ** 2
        r += (positions[u, i] - positions[v, i]) ** 2
    return np.sqrt(max(4 * q * r - (q + r - p) ** 2, least * (p + q + r))) / 4, p, q, r


@kernel
def _area_around(u: int, positions: Floats, sphere: _Sphere) -> float:
    """Return the area of the triangles around u."""
    total, n = 1e-12, sphere.degrees[u]
    for i in range(n):
        v, w = sphere.rings[u, i], sphere.rings[u, (i + 1) % n]
        if v != sphere.apex and w != sphere.apex:
            total += _measures(positions, u, v, w)[0]
    return total


@kernel
def _measure(u: int, surface: _Surface, sphere: _Sphere, around: Floats) -> None:
    """Set the measures of the triangles around u, grown to the masses."""
    masses, areas, n = surface.masses, surface.areas, sphere.degrees[u]
    for i in range(n):
        v, w = sphere.rings[u, i], sphere.rings[u, i + 1 if i + 1 < n else 0]
        if v != sphere.apex and w != sphere.apex:
            area, p, q, r = _measures(surface.positions, u, v, w)
            scale = (masses[u] + masses[v] + masses[w]) / (areas[u] + areas[v] + areas[w])
            around[i, 0], around[i, 1], around[i, 2], around[i, 3] = area * scale, p * scale, q * scale, r * scale


@kernel
def _energy(
    u: int, s: Floats, around: Floats, sphere: _Sphere, gradient: Floats, hessian: Floats, derived: bool
) -> float:
    """Return the energy of the triangles around u at s; set its derivatives there if they are asked for.

    `around` (MOST_NEIGHBOURS, 4): of each triangle, its area and the squares of its edges, as `_measure` sets them.
    """
    total, n, k = 0.0, sphere.degrees[u], _CONFORMAL
    if derived:
        gradient[:] = 0
        hessian[:] = 0
    for i in range(n):
        v, w = sphere.rings[u, i], sphere.rings[u, i + 1 if i + 1 < n else 0]
        b, c = sphere.directions[v], sphere.directions[w]
        det = _det(s, b, c)
        if v == sphere.apex or w == sphere.apex:
            if det <= 1e-9:
                return np.inf
            continue
        if det <= 1e-13:
            return np.inf
        area, p, q, r = around[i, 0], around[i, 1], around[i, 2], around[i, 3]
        value = 0.0
        for j in range(3):
            value += (b[j] - s[j]) * (c[j] - s[j]) * p
            value += (s[j] - b[j]) * (c[j] - b[j]) * q
            value += (s[j] - c[j]) * (b[j] - c[j]) * r
        factor = np.sqrt(value / (area * det)) / (det * det * det)
        total += value * value * factor
        if not derived:
            continue
        normal = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
        for j in range(3):
            dj = p * (2 * s[j] - b[j] - c[j]) + (q - r) * (c[j] - b[j])
            gj = value * normal[j] / det
            gradient[j] += factor * value * (k * dj - (k + 1) * gj)
            for m in range(j + 1):
                dm = p * (2 * s[m] - b[m] - c[m]) + (q - r) * (c[m] - b[m])
                gm = value * normal[m] / det
                term = k * (k - 1) * dj * dm - k * (k + 1) * (dj * gm + dm * gj) + (k + 1) * (k + 2) * gj * gm
                if j == m:
                    term += 2 * k * p * value
                hessian[j, m] += factor * term
    for j in range(3):
        for m in range(j):
            hessian[m, j] = hessian[j, m]
    return total


@kernel
def _tangents(s: Floats, bound: bool, first: Floats, second: Floats) -> None:
    """Set two unit tangents at s; for a vertex of the boundary one, in the plane x = 0."""
    first[:], second[:] = 0, 0
    if bound:
        first[1], first[2] = -s[2], s[1]
        return
    first[0 if abs(s[0]) < 0.6 else 1] = 1
    along = first[0] * s[0] + first[1] * s[1] + first[2] * s[2]
    for i in range(3):
        first[i] -= along * s[i]
    _normalise(first)
    second[0] = s[1] * first[2] - s[2] * first[1]
    second[1] = s[2] * first[0] - s[0] * first[2]
    second[2] = s[0] * first[1] - s[1] * first[0]


@kernel
def _newton(
    s: Floats, first: Floats, second: Floats, gradient: Floats, hessian: Floats, bound: bool
) -> tuple[float, float]:
    """Return Newton's step along the tangents, of a Hessian made positive definite, half a radian at most."""
    radial = s[0] * gradient[0] + s[1] * gradient[1] + s[2] * gradient[2]
    g1, g2, h11, h12, h22 = 0.0, 0.0, -radial, 0.0, -radial
    for j in range(3):
        g1 += first[j] * gradient[j]
        g2 += second[j] * gradient[j]
        for k in range(3):
            h11 += first[j] * hessian[j, k] * first[k]
            h12 += first[j] * hessian[j, k] * second[k]
            h22 += second[j] * hessian[j, k] * second[k]
    if bound:
        x1, x2 = -g1 / max(abs(h11), 1e-300), 0.0
    else:
        middle, half = (h11 + h22) / 2, np.sqrt(((h11 - h22) / 2) ** 2 + h12**2)
        shift = max(0.0, 0.05 * (abs(middle) + half) - (middle - half))
        h11, h22 = h11 + shift, h22 + shift
        det = max(h11 * h22 - h12 * h12, 1e-300)
        x1, x2 = -(h22 * g1 - h12 * g2) / det, -(h11 * g2 - h12 * g1) / det
    shrink = min(1.0, 0.5 / max(np.sqrt(x1 * x1 + x2 * x2), 1e-300))
    return x1 * shrink, x2 * shrink


@kernel
def _move(u: int, surface: _Surface, sphere: _Sphere, room: Floats, around: Floats) -> None:
    """Take Newton's step of a vertex, shortened until the energy falls; `room` (9, 3) and `around` are to work in."""
    gradient, hessian, trial = room[0], room[1:4], room[4]
    first, second, s, bound = room[6], room[7], room[8], sphere.bound[u]
    s[:] = sphere.directions[u]
    _measure(u, surface, sphere, around)
    before = _energy(u, s, around, sphere, gradient, hessian, True)
    _tangents(s, bound, first, second)
    x1, x2 = _newton(s, first, second, gradient, hessian, bound)
    for _ in range(7):
        for j in range(3):
            trial[j] = s[j] + x1 * first[j] + x2 * second[j]
        _normalise(trial)
        energy = _energy(u, trial, around, sphere, gradient, hessian, False)
        if energy < before:
            sphere.directions[u] = trial
            return
        x1, x2 = 0.4 * x1, 0.4 * x2


@kernel
def _toward_fan(u: int, v: int, directions: Floats, rings: Rings, n: int, goal: Floats) -> None:
    """Set a point in the middle of the angle at v that the triangles around u span: near v all is visible."""
    at = directions[v]
    one, other = np.zeros(3), np.zeros(3)
    turn, last, reach = 0.0, 0.0, 1.0
    for i in range(1, n):
        w = directions[rings[u, i]]
        along = at[0] * w[0] + at[1] * w[1] + at[2] * w[2]
        if i == 1:
            one[:] = w - along * at
            _normalise(one)
            other[0] = at[1] * one[2] - at[2] * one[1]
            other[1] = at[2] * one[0] - at[0] * one[2]
            other[2] = at[0] * one[1] - at[1] * one[0]
        else:
            angle = np.arctan2(
                other[0] * w[0] + other[1] * w[1] + other[2] * w[2], one[0] * w[0] + one[1] * w[1] + one[2] * w[2]
            )
            turn += (angle - last) % (2 * np.pi)
            last = angle
        reach = min(reach, np.sqrt(max(1 - along * along, 0.0)))
    goal[:] = at + reach * (np.cos(turn / 2) * one + np.sin(turn / 2) * other)


@kernel
def _start(u: int, v: int, surface: _Surface, sphere: _Sphere, room: Floats, around: Floats) -> bool:
    """Put u where its triangles are counter-clockwise, on the way from v; return whether there is such a point."""
    gradient, hessian, trial, goal = room[0], room[1:4], room[4], room[5]
    directions, rings, bound, apex = sphere.directions, sphere.rings, sphere.bound, sphere.apex
    n, at, best = sphere.degrees[u], directions[v], np.inf
    _measure(u, surface, sphere, around)
    for way in range(2):
        goal[:] = 0
        if bound[u]:
            for i in range(n):
                w = rings[u, i]
                if w != v and w != apex and (rings[u, (i + 1) % n] == apex or rings[u, (i + n - 1) % n] == apex):
                    goal[:] = directions[w]
        elif way == 0:
            for i in range(n):
                goal += directions[rings[u, i]]
        else:
            _toward_fan(u, v, directions, rings, n, goal)
        _normalise(goal)
        share = 1.0 if way == 0 and not bound[u] else 0.6
        for _ in range(40):
            trial[:] = at + share * (goal - at)
            _normalise(trial)
            now = _energy(u, trial, around, sphere, gradient, hessian, False)
            if now < best:
                best = now
                directions[u] = trial
            elif now < np.inf:
                break
            share *= 0.6
        if bound[u]:
            break
    return best < np.inf


@kernel
def _grow(surface: _Surface, sphere: _Sphere, alive: Flags, order: Index, kept: int) -> None:
    """Undo the collapses from the last to number `kept`; ends early where rounding leaves no room for a vertex."""
    room, around, path = np.zeros((9, 3)), np.zeros((MOST_NEIGHBOURS, 4)), np.zeros(2 * MOST_NEIGHBOURS, np.int32)
    positions, masses, areas = surface.positions, surface.masses, surface.areas
    rings, degrees, apex = sphere.rings, sphere.degrees, sphere.apex
    for step in range(len(order)):
        masses[order[step, 1]] += masses[order[step, 0]]
    present, number = np.zeros(len(masses), np.int64), 0
    for v in range(len(alive)):
        if alive[v] and v != apex:
            areas[v] = _area_around(v, positions, sphere)
            present[number] = v
            number += 1
    swept = number
    for step in range(len(order) - 1, kept - 1, -1):
        u, v = order[step]
        masses[v] -= masses[u]
        areas[u] = _area_around(u, positions, sphere)
        if not _start(u, v, surface, sphere, room, around):
            return
        insert(u, v, rings, degrees, apex, path)
        alive[u], present[number] = True, u
        number += 1
        for i in range(degrees[u]):
            w = rings[u, i]
            if w != apex:
                areas[w] = _area_around(w, positions, sphere)
        for i in range(-2, degrees[u]):
            w = u if i < 0 else rings[u, i]
            if w != apex:
                _move(w, surface, sphere, room, around)
        if number >= _GROWTH * swept or step == kept:
            swept = number
            for _ in range(_LAST_SWEEPS if step == kept else _SWEEPS):
                for w in present[:number]:
                    _move(w, surface, sphere, room, around)
