"""Cut polygons into triangles: convex ones as a fan, others by ear clipping in their plane.

The plane of a polygon that is not flat is that of its area vector, the sum over its edges (Newell). Many polygons are
clipped at once, since files have tens of thousands.

Source: Meisters, Polygons have ears (1975); O'Rourke, Computational geometry in C (1998), section 1.6: a cut changes
the status of the two neighbours only. The ear with the shortest cut goes first, which avoids slivers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetTooLargeError

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_FLAT = 1e-12
"""Area, of the polygon's or of its extent squared, up to which a triangle counts as having none."""
_AT_ONCE = 2**18
_MOST_WORK = 10**8
"""Sum over the polygons to clip of their corners squared, which takes a few seconds."""


@dataclass(frozen=True)
class Triangulation:
    """Polygons as triangles."""

    triangles: _Index  # (T, 3) int64: corners, counted over all polygons
    polygons: _Index  # (T,) int64: the polygon of each triangle, in ascending order; one of n corners has n - 2
    clipped: int  # how many polygons ears were clipped from, because a fan would have left their outlines

    def runs(self, rows: _Index | slice = slice(None)) -> tuple[tuple[int, int], ...]:
        """Return how many polygons of how many corners follow each other in rows of triangles, in ascending order.

        Empty if they are triangles all.
        """
        polygons = self.polygons[rows]
        corners = np.diff(np.flatnonzero(np.diff(polygons, prepend=-1, append=-1))) + 2
        if not len(corners) or corners.max() == 3:
            return ()
        starts = np.flatnonzero(np.diff(corners, prepend=-1))
        lengths = np.diff(starts, append=len(corners))
        return tuple(zip(corners[starts].tolist(), lengths.tolist(), strict=True))

    def notices(self) -> tuple[str, ...]:
        """Return a sentence about polygons that became triangles, if there are any."""
        cut = int((np.bincount(self.polygons) > 1).sum())
        if not cut:
            return ()
        polygons = f"{cut:,} polygon{'s' if cut > 1 else ''} with more than three corners became triangles"
        clipped = f", {self.clipped:,} of them concave and cut by ear clipping" if self.clipped else ""
        return (f"{polygons}{clipped}.",)


def cut_polygons(points: _Floats, sizes: _Index) -> Triangulation:
    """Cut polygons into triangles that face as they do.

    `points`, (C, 3) float64: the corners of all polygons, one after the other; within the range of 32-bit floats.
    `sizes`, (P,) int64: how many corners each has, at least three. Returns a fan from the first corner where each of
    its triangles faces as the polygon does, and where ears cannot be clipped because the outline crosses itself.
    """
    starts = np.cumsum(sizes) - sizes
    polygons = np.repeat(np.arange(len(sizes)), sizes - 2)
    first = np.cumsum(sizes - 2) - (sizes - 2)
    step = np.arange(len(polygons)) - first[polygons]
    triangles = starts[polygons, None] + np.stack([np.zeros_like(step), step + 1, step + 2], axis=1)
    closing = (sizes[polygons] == 4) & (step == 1)
    triangles[closing] = triangles[closing][:, [1, 2, 0]]  # a quad's second triangle begins at the cut's other end
    concave, normals = _concave(points, triangles, polygons, sizes, first)
    if int((sizes[concave] ** 2).sum()) > _MOST_WORK:
        raise AssetTooLargeError(
            f"The file has concave polygons with up to {sizes[concave].max():,} corners, which take too long to cut.",
            advice="Cut them into triangles in a modelling program.",
        )
    clipped = 0
    # Polygons of about the same size are clipped together.
    likeness = np.floor(4 * np.log(sizes[concave]))
    for kind in np.unique(likeness):
        alike = concave[likeness == kind]
        step_size = max(1, _AT_ONCE // int(sizes[alike].max()))
        for some in (alike[at : at + step_size] for at in range(0, len(alike), step_size)):
            corners, whole = _clip(points, starts[some], sizes[some], normals[some])
            some, corners = some[whole], corners[whole]
            clipped += len(some)
            number, ear = np.nonzero(np.arange(corners.shape[1]) < sizes[some, None] - 2)
            triangles[first[some[number]] + ear] = starts[some[number], None] + corners[number, ear]
    return Triangulation(triangles, polygons, clipped)


def _concave(
    points: _Floats, triangles: _Index, polygons: _Index, sizes: _Index, first: _Index
) -> tuple[_Index, _Floats]:
    """Return the polygons whose fan has a triangle against them, and the area vectors (P, 3) of all."""
    normals = np.zeros((len(sizes), 3))
    wrong = np.zeros(len(sizes), bool)
    for at in range(0, len(sizes), _AT_ONCE):
        some = slice(at, at + _AT_ONCE)
        if (sizes[some] == 3).all():
            continue
        rows = slice(first[at], first[at] + int((sizes[some] - 2).sum()))
        a, b, c = points[triangles[rows].T]
        areas = np.cross(b - a, c - a)
        normals[some] = np.add.reduceat(areas, first[some] - first[at])
        facing = np.einsum("ij,ij->i", areas, normals[polygons[rows]])
        least = np.minimum.reduceat(facing, first[some] - first[at])
        squares = np.einsum("ij,ij->i", normals[some], normals[some])
        wrong[some] = (least < -_FLAT * squares) & (squares > 0)
    return np.flatnonzero(wrong), normals


def _clip(points: _Floats, starts: _Index, sizes: _Index, normals: _Floats) -> tuple[_Index, NDArray[np.bool_]]:
    """Return corners (P, N - 2, 3) of triangles, counted in each polygon, and the polygons (P,) that they fill."""
    ring = _Rings(_flatten(points, starts, sizes, normals), sizes)
    corners = np.zeros((len(sizes), int(sizes.max()) - 2, 3), np.int64)
    left = sizes.copy()
    whole = np.ones(len(sizes), bool)
    for step in range(corners.shape[1]):
        rows = np.flatnonzero(whole & (left >= 3))
        ears = ring.cost[rows].argmin(axis=1)
        whole[rows] = np.isfinite(ring.cost[rows, ears])
        ears, rows = ears[whole[rows]], rows[whole[rows]]
        corners[rows, step] = np.stack([ring.before[rows, ears], ears, ring.after[rows, ears]], axis=1)
        ring.remove(rows, ears)
        left[rows] -= 1
    return corners, whole


def _flatten(points: _Floats, starts: _Index, sizes: _Index, normals: _Floats) -> _Floats:
    """Return the corners (2, P, N) of polygons in their planes, at most 1 from the first; those too many repeat it."""
    numbers = np.arange(int(sizes.max()))
    corners = points[starts[:, None] + np.where(numbers < sizes[:, None], numbers, 0)]
    corners = corners - corners[:, :1]
    corners /= np.abs(corners).max(axis=(1, 2), keepdims=True)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    right = np.cross(axis, normals)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([np.einsum("pni,pi->pn", corners, along) for along in (right, np.cross(normals, right))])


class _Rings:
    """The corners (P, N) that polygons have left; `cost` is the squared length of a cut, infinite but for ears."""

    def __init__(self, points: _Floats, sizes: _Index) -> None:
        self._x, self._y = points
        numbers = np.arange(self._x.shape[1])
        self.before = np.where(numbers > 0, numbers - 1, sizes[:, None] - 1)
        self.after = np.where(numbers < sizes[:, None] - 1, numbers + 1, 0)
        self.cost = np.full(self._x.shape, np.inf)
        self._blocks = np.zeros(self._x.shape, bool)  # corners left that are not convex
        for update in (self._turn, self._measure):
            for number in numbers:
                rows = np.flatnonzero(number < sizes)
                update(rows, np.full(len(rows), number))

    def remove(self, rows: _Index, corners: _Index) -> None:
        """Take one corner away from each of some polygons."""
        before, after = self.before[rows, corners], self.after[rows, corners]
        self.after[rows, before], self.before[rows, after] = after, before
        self.cost[rows, corners] = np.inf
        for update in (self._turn, self._measure):
            update(rows, before)
            update(rows, after)

    def _around(self, rows: _Index, corners: _Index) -> list[tuple[_Floats, _Floats]]:
        three = (self.before[rows, corners], corners, self.after[rows, corners])
        return [(self._x[rows, at, None], self._y[rows, at, None]) for at in three]

    def _turn(self, rows: _Index, corners: _Index) -> None:
        self._blocks[rows, corners] = _area(*self._around(rows, corners))[:, 0] <= _FLAT

    def _measure(self, rows: _Index, corners: _Index) -> None:
        a, b, c = self._around(rows, corners)
        cost = np.square(c[0] - a[0])[:, 0] + np.square(c[1] - a[1])[:, 0]
        cost[self._blocks[rows, corners]] = np.inf
        self.cost[rows, corners] = cost
        kept = np.flatnonzero(np.isfinite(cost))
        rows, corners = rows[kept], corners[kept]
        a, b, c = ((x[kept], y[kept]) for x, y in (a, b, c))
        others = self._x[rows], self._y[rows]
        inside = self._blocks[rows]
        for start, end in ((a, b), (b, c), (c, a)):
            inside &= _area(start, end, others) >= -_FLAT
            inside &= (others[0] != start[0]) | (others[1] != start[1])  # the outline may touch itself at a corner
        self.cost[rows[inside.any(axis=1)], corners[inside.any(axis=1)]] = np.inf


def _area(a: tuple[_Floats, _Floats], b: tuple[_Floats, _Floats], c: tuple[_Floats, _Floats]) -> _Floats:
    """Return twice the signed area of triangles, positive if counter-clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
