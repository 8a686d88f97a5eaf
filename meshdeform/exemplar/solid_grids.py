"""Which nodes of a grid lie inside a union of closed solids, and how far all are from its surface.

The winding number of a node is the sum over the crossings of the ray from it along -x, +1 where the ray's opposite
enters a solid; it is positive inside a union of closed solids that face outward, whether they overlap or not. A ray
whose crossings do not add up to 0 has met a hole and says nothing; if there are any, rays along all three axes vote.
The distance to the nearest triangle is exact within a band, found triangle by triangle over the nodes near it.

Source: Ericson 2005, Real-Time Collision Detection, section 5.1.5 (the nearest point on a triangle).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.kernels import kernel
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["Grid", "SolidGrid", "nearest_points", "solid_grid"]

_OFFSET = (0.3819660112501051, 0.7548776662466927)
"""Of the rays, in spacings: irrational, so that none meets an edge."""
_MARGIN = 4


@dataclass(frozen=True)
class Grid:
    """Nodes at origin + spacing * (i, j, k); `origin` (3,) float64."""

    origin: Floats
    spacing: float
    shape: tuple[int, int, int]


@dataclass(frozen=True)
class SolidGrid:
    """What is known at the nodes (X, Y, Z) of a grid.

    `inside` bool; `distance` float64 to the surface, at most `band`; `nearest` int64: the nearest triangle, -1 beyond
    the band.
    """

    grid: Grid
    inside: Flags
    distance: Floats
    nearest: Index
    band: float


def solid_grid(verts: Floats, faces: Index, spacing: float, band: float, least_x: float | None = None) -> SolidGrid:
    """Return the grid of closed solids; `band` in spacings; with `least_x`, its first nodes have that x."""
    low, high = verts.min(0) - _MARGIN * spacing, verts.max(0) + _MARGIN * spacing
    low[1:] -= spacing * np.array(_OFFSET)
    if least_x is not None:
        low[0] = least_x
    count = np.ceil((high - low) / spacing).astype(int) + 1
    grid = Grid(low, spacing, (int(count[0]), int(count[1]), int(count[2])))
    distance = np.full(grid.shape, (band * spacing) ** 2)
    nearest = np.full(grid.shape, -1)
    _approach(verts, faces, low, spacing, band, distance, nearest)
    return SolidGrid(grid, _inside(verts, faces, grid), np.sqrt(distance), nearest, band * spacing)


def _inside(verts: Floats, faces: Index, grid: Grid) -> Flags:
    """Return which nodes (X, Y, Z) are inside; where a surface has holes, as most rays say that meet none."""
    votes = _votes(verts, faces, grid, 0)
    if votes.all():
        return votes > 0
    return np.asarray(votes + _votes(verts, faces, grid, 1) + _votes(verts, faces, grid, 2) > 0)


def _votes(verts: Floats, faces: Index, grid: Grid, axis: int) -> Index:
    """Return by rays along an axis 1 of nodes (X, Y, Z) inside, -1 outside, and 0 where a ray leaves by a hole."""
    order = [axis, (axis + 1) % 3, (axis + 2) % 3]
    count = [grid.shape[k] for k in order]
    crossings = np.zeros((count[0] + 1, *count[1:]), np.int32)
    _cross(np.ascontiguousarray(verts[:, order]), faces, grid.origin[order], grid.spacing, crossings)
    winding = np.cumsum(crossings, axis=0)
    votes = np.where(winding[:-1] > 0, 1, -1) * (winding[-1] == 0)
    return np.transpose(votes, np.argsort(order))


def nearest_points(points: Floats, verts: Floats, faces: Index, solid: SolidGrid) -> tuple[Floats, Floats]:
    """Return the nearest points (P, 3) on the surface to points within the band, and their distances (P,).

    A point farther away than the triangles nearest to the nodes around it is its own nearest point, at distance inf.
    """
    positions, distances = points.copy(), np.full(len(points), np.inf)
    _nearest(points, verts, faces, solid.grid.origin, solid.grid.spacing, solid.nearest, positions, distances)
    return positions, distances


@kernel
def _cross(verts: Floats, faces: Index, low: Floats, spacing: float, crossings: NDArray[np.int32]) -> None:
    """Add the crossings of the rays along x with all triangles."""
    count, rows, columns = crossings.shape
    for f in range(len(faces)):
        a, b, c = verts[faces[f, 0]], verts[faces[f, 1]], verts[faces[f, 2]]
        area = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
        if area == 0:
            continue
        j0 = max(int(np.ceil((min(a[1], b[1], c[1]) - low[1]) / spacing)), 0)
        j1 = min(int(np.floor((max(a[1], b[1], c[1]) - low[1]) / spacing)), rows - 1)
        k0 = max(int(np.ceil((min(a[2], b[2], c[2]) - low[2]) / spacing)), 0)
        k1 = min(int(np.floor((max(a[2], b[2], c[2]) - low[2]) / spacing)), columns - 1)
        for j in range(j0, j1 + 1):
            y = low[1] + j * spacing
            for k in range(k0, k1 + 1):
                z = low[2] + k * spacing
                u = ((b[1] - y) * (c[2] - z) - (b[2] - z) * (c[1] - y)) / area
                v = ((c[1] - y) * (a[2] - z) - (c[2] - z) * (a[1] - y)) / area
                w = 1 - u - v
                if u < 0 or v < 0 or w < 0:
                    continue
                x = u * a[0] + v * b[0] + w * c[0]
                i = min(max(int(np.ceil((x - low[0]) / spacing)), 0), count - 1)
                crossings[i, j, k] += -1 if area > 0 else 1


@kernel
def _nearest_on_triangle(p: Floats, a: Floats, b: Floats, c: Floats, out: Floats) -> float:
    """Set the point on a triangle that is nearest to p, and return the squared distance."""
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for i in range(3):
        ab, ac = b[i] - a[i], c[i] - a[i]
        d1 += ab * (p[i] - a[i])
        d2 += ac * (p[i] - a[i])
        d3 += ab * (p[i] - b[i])
        d4 += ac * (p[i] - b[i])
        d5 += ab * (p[i] - c[i])
        d6 += ac * (p[i] - c[i])
    vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    v, w = 0.0, 0.0
    if d1 <= 0 and d2 <= 0:
        pass
    elif d3 >= 0 and d4 <= d3:
        v = 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v = d1 / max(d1 - d3, 1e-300)
    elif d6 >= 0 and d5 <= d6:
        w = 1.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        w = d2 / max(d2 - d6, 1e-300)
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / max((d4 - d3) + (d5 - d6), 1e-300)
        v = 1 - w
    else:
        total = va + vb + vc
        v, w = vb / max(total, 1e-300), vc / max(total, 1e-300)
    squared = 0.0
    for i in range(3):
        out[i] = a[i] + v * (b[i] - a[i]) + w * (c[i] - a[i])
        squared += (p[i] - out[i]) ** 2
    return squared


@kernel
def _approach(
    verts: Floats, faces: Index, low: Floats, spacing: float, band: float, distance: Floats, nearest: Index
) -> None:
    """Set the least squared distances and their triangles."""
    shape, reach = distance.shape, band * spacing
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    p, position = np.zeros(3), np.zeros(3)
    for f in range(len(faces)):
        a, b, c = verts[faces[f, 0]], verts[faces[f, 1]], verts[faces[f, 2]]
        for axis in range(3):
            least, most = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
            first[axis] = max(int(np.ceil((least - reach - low[axis]) / spacing)), 0)
            last[axis] = min(int(np.floor((most + reach - low[axis]) / spacing)), shape[axis] - 1)
        for i in range(first[0], last[0] + 1):
            p[0] = low[0] + i * spacing
            for j in range(first[1], last[1] + 1):
                p[1] = low[1] + j * spacing
                for k in range(first[2], last[2] + 1):
                    p[2] = low[2] + k * spacing
                    squared = _nearest_on_triangle(p, a, b, c, position)
                    if squared < distance[i, j, k]:
                        distance[i, j, k], nearest[i, j, k] = squared, f


@kernel
def _nearest(
    points: Floats,
    verts: Floats,
    faces: Index,
    low: Floats,
    spacing: float,
    nearest: Index,
    positions: Floats,
    distances: Floats,
) -> None:
    """Set points and distances by the triangles that are nearest to the nodes around each point."""
    shape, position = nearest.shape, np.zeros(3)
    for number in range(len(points)):
        p, best = points[number].copy(), np.inf
        i = min(max(int((p[0] - low[0]) / spacing), 0), shape[0] - 2)
        j = min(max(int((p[1] - low[1]) / spacing), 0), shape[1] - 2)
        k = min(max(int((p[2] - low[2]) / spacing), 0), shape[2] - 2)
        for corner in range(8):
            f = nearest[i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)]
            if f >= 0:
                squared = _nearest_on_triangle(p, verts[faces[f, 0]], verts[faces[f, 1]], verts[faces[f, 2]], position)
                if squared < best:
                    best = squared
                    positions[number] = position
        distances[number] = np.sqrt(best)
