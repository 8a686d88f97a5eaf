"""Find the nearest triangle at each pixel, and interpolate on it, in numpy.

Vertices are snapped to 1/256 pixel. A pixel belongs to a triangle if its centre is inside by the top-left rule, so
neighbouring triangles neither overlap nor leave gaps. Edge functions are integers below 2^53, so float64 is exact. Most
triangles of a fine mesh lie between pixel centres and are dropped by the cells of their corners; of the others only
covered pixels are visited, in spans of rows.

`interpolated` is perspective-correct. With p the pixel in normalised coordinates and q_i = (x_i - p_x w_i, y_i - p_y
w_i), the areas a_0 = q_1 x q_2 and so on give the barycentric coordinates b_i = a_i / (a_0 + a_1 + a_2).

Sources: Pineda 1988, A Parallel Algorithm for Polygon Rasterization (edge functions); Olano and Greer 1997, Triangle
Scan Conversion using 2D Homogeneous Coordinates (the areas).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import ShapeError
from meshdeform.geometry.copies import first_alike

EMPTY_DEPTH = 3.0
"""Depth where there is no face: greater than that of any point in front of the cameras, even past the far plane."""

_SUB = 256
_FAR = 2.0**22
"""Clamp of snapped coordinates, far off the picture, so that products are exact."""
_LARGEST_SIDE = 1 << 14
_AT_ONCE = 1 << 16
"""Triangles, rows or pixels in memory at a time; does not affect the result."""
_OVERDRAW = 64
"""How many times the triangles may cover the picture before copies among them are looked for."""
_BOTH = np.array([1, 1], np.uint8).view(np.uint16)[0]

_Floats = NDArray[np.float64]
_Singles = NDArray[np.float32]
_Index = NDArray[np.int64]
_Cells = NDArray[np.int16]


def nearest_faces(
    clip: NDArray[np.floating], faces: _Index, height: int, width: int, behind: _Singles | None = None
) -> tuple[_Index, _Singles]:
    """Find the nearest triangle at each pixel centre; triangles are two-sided.

    Triangles with a vertex at or behind the camera plane are dropped.

    Parameters
    ----------
    clip : (B, V, 4) floating
        Vertex positions in clip space (x right, y up).
    faces : (F, 3) int64
    behind : (B, H, W) float32, optional
        Depth of each pixel up to which triangles are ignored, to find the next layer of a transparent surface.

    Returns
    -------
    (B, H, W) int64, the face, -1 where there is none, row 0 on top; and (B, H, W) float32, the normalised device depth:
    -1 at the near plane, 1 at the far one, above 1 beyond it, `EMPTY_DEPTH` where there is no face.

    Raises
    ------
    ShapeError
        `clip` is not (B, V, 4) or `faces` not (F, 3).
    """
    if clip.ndim != 3 or clip.shape[2] != 4 or faces.ndim != 2 or faces.shape[1] != 3:
        raise ShapeError(f"expected clip (B, V, 4) and faces (F, 3), got {clip.shape} and {faces.shape}")
    found = np.full((len(clip), height * width), -1, np.int64)
    depth = np.full((len(clip), height * width), EMPTY_DEPTH, np.float32)
    corners_of_faces = np.ascontiguousarray(faces.T)
    for view, points in enumerate(clip):
        seen = points[:, 3] > 1e-6
        corners = _snapped(points, seen, height, width)
        picture = _Picture(found[view], depth[view], None if behind is None else behind[view].ravel(), width)
        for start in range(0, len(faces), _AT_ONCE):
            some = corners_of_faces[:, start : start + _AT_ONCE]
            picture.draw(
                _triangles(corners, some, start, None if seen.all() else seen, most=_OVERDRAW * height * width)
            )
    shape = (len(clip), height, width)
    return found.reshape(shape), depth.reshape(shape)


@dataclass(frozen=True)
class _Corners:
    """Snapped vertices (V,): `x` and `y` in 1/256 pixel, `z` the depth, and the cells around them.

    `first`, (V,) int32, has a pair of int16: the first column and row whose centre is not left of or above the vertex;
    `last`: the last ones whose centre is not right of or below it.
    """

    x: _Floats
    y: _Floats
    z: _Floats
    first: NDArray[np.int32]
    last: NDArray[np.int32]


def _snapped(points: NDArray[np.floating], seen: NDArray[np.bool_], height: int, width: int) -> _Corners:
    x, y, z, w = points.T.astype(np.float64)
    w = np.where(seen, w, 1.0)
    x = np.rint(np.clip((x / w * 0.5 + 0.5) * width * _SUB, -_FAR, _FAR))
    y = np.rint(np.clip((0.5 - y / w * 0.5) * height * _SUB, -_FAR, _FAR))
    first, last = np.empty((len(x), 2), np.int16), np.empty((len(x), 2), np.int16)
    for axis, (position, side) in enumerate(((x, width), (y, height))):
        cell = position / _SUB - 0.5
        first[:, axis] = np.clip(np.ceil(cell), 0, _LARGEST_SIDE)
        last[:, axis] = np.clip(np.floor(cell), -1, side - 1)
    return _Corners(x, y, z / w, first.view(np.int32)[:, 0], last.view(np.int32)[:, 0])


@dataclass(frozen=True)
class _Triangles:
    """Triangles (T,) that may cover a pixel's centre.

    They cover `rows` rows from `top` on, and no column outside of `left` .. `right`. Edge q crosses a row at ``begin[q]
    + step[q] row`` if the triangle is to the right of it, or at ``end[q] + step[q] row`` if it is to the left; the
    other one is infinite. The depth is ``z_0 + z_x column + z_y row``.
    """

    face: _Index
    top: _Index
    rows: _Index
    left: _Floats
    right: _Floats
    begin: _Floats
    end: _Floats
    step: _Floats
    z_0: _Floats
    z_x: _Floats
    z_y: _Floats


def _near_centres(corners: _Corners, faces: _Index, seen: NDArray[np.bool_] | None) -> tuple[_Index, _Cells, _Cells]:
    """Return which of faces (3, F) have a pixel's centre in their boxes, and the first and last (2, K) column and row.

    `seen`: whether each vertex is in front of the camera; None if all are.
    """
    low, high = (
        _extreme(choose, [cells.take(each) for each in faces])
        for choose, cells in ((np.minimum, corners.first), (np.maximum, corners.last))
    )
    kept = np.flatnonzero((low.view(np.int16) <= high.view(np.int16)).view(np.uint16) == _BOTH)
    if seen is not None:
        kept = kept[seen[faces[:, kept]].all(0)]
    first, last = (each.take(kept).view(np.int16).reshape(-1, 2).T for each in (low, high))
    return kept, first, last


def _triangles(corners: _Corners, faces: _Index, start: int, seen: NDArray[np.bool_] | None, most: float) -> _Triangles:
    """Set up those of faces (3, F), the first of which is number `start`, that may cover a pixel's centre.

    If they may cover more than so many pixels, copies are left out: of several at the same depth the first remains.
    """
    kept, (left, top), (right, bottom) = _near_centres(corners, faces, seen)
    if float(((right - left + 1.0) * (bottom - top + 1.0)).sum()) > most:
        some = faces.take(kept, 1)
        positions = [each.take(some).view(np.int64) for each in (corners.x, corners.y, corners.z)]
        once = first_alike(np.concatenate(positions).T)
        kept, left, top, right, bottom = (each[once] for each in (kept, left, top, right, bottom))
    faces = faces.take(kept, 1)
    x, y, z = (each.take(faces) for each in (corners.x, corners.y, corners.z))
    # Edge q is opposite to corner q. Inside, a column + b row + c is positive, or zero if a tie is won.
    a, b = np.empty_like(x), np.empty_like(x)
    for q in range(3):
        one, two = (q + 1) % 3, (q + 2) % 3
        np.subtract(y[one], y[two], out=a[q])
        np.subtract(x[two], x[one], out=b[q])
    area = b[2] * a[1] - a[2] * b[1]
    sign = np.sign(area)
    a *= sign
    b *= sign
    c = np.empty_like(x)
    for q in range(3):
        np.multiply(_SUB // 2 - x[(q + 1) % 3], a[q], out=c[q])
        c[q] += (_SUB // 2 - y[(q + 1) % 3]) * b[q]
    level = a == 0
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.abs(area)
        planes = [(each[0] * z[0] + each[1] * z[1] + each[2] * z[2]) * inverse for each in (a, b, c)]
        # A half more or less than an integer decides ties, and leaves a margin for rounding.
        wins = np.where((a > 0) | (level & (b < 0)), 0.5, -0.5)
        scale = -1.0 / (a * _SUB)
        at, step = (c + wins) * scale, b * scale * _SUB
    step[level] = 0.0
    first_row = top.astype(np.int64)
    if level.any():  # the uppermost row belongs to the triangle above if the edge is on its pixels' centres
        first_row += (level & (b > 0) & (c + b * _SUB * first_row == 0)).any(0)
    return _Triangles(
        face=start + kept,
        top=first_row,
        rows=np.where(area != 0, np.maximum(bottom - first_row + 1, 0), 0),
        left=left.astype(np.float64),
        right=right.astype(np.float64),
        begin=np.where(a > 0, at, -np.inf),
        end=np.where(a < 0, at, np.inf),
        step=step,
        z_0=planes[2],
        z_x=planes[0] * _SUB,
        z_y=planes[1] * _SUB,
    )


def _extreme(choose: np.ufunc, cells: list[NDArray[np.int32]]) -> NDArray[np.int32]:
    """Return the least or greatest of three pairs of cells each."""
    a, b, c = (each.view(np.int16) for each in cells)
    found: NDArray[np.int32] = choose(choose(a, b), c).view(np.int32)
    return found


@dataclass(frozen=True)
class _Picture:
    """The nearest faces so far and their depths (H * W), and the depth up to which triangles are ignored."""

    face: _Index
    depth: _Singles
    behind: _Singles | None
    width: int

    def draw(self, triangles: _Triangles) -> None:
        """Draw triangles; of several at the same depth the first one remains."""
        t = triangles
        for some in _batches(t.rows):
            item, within = _repeated(t.rows, some)
            row = t.top.take(item) + within
            begin, end = t.left.take(item), t.right.take(item)
            for q in range(3):
                crossing = t.step[q].take(item) * row
                np.maximum(begin, t.begin[q].take(item) + crossing, out=begin)
                np.minimum(end, t.end[q].take(item) + crossing, out=end)
            begin = np.ceil(begin)
            length = np.floor(end) - begin + 1
            covered = np.flatnonzero(length > 0)
            item, row, begin = item.take(covered), row.take(covered), begin.take(covered)
            z_x = t.z_x.take(item)
            z = t.z_0.take(item) + t.z_y.take(item) * row + z_x * begin
            first = row * self.width + begin.astype(np.int64)
            self._draw_spans(t.face.take(item), first, length.take(covered).astype(np.int64), z, z_x)

    def _draw_spans(self, face: _Index, first: _Index, length: _Index, z: _Floats, z_x: _Floats) -> None:
        """Draw spans of pixels of faces (S,) with their first pixel, its depth, and the change of depth per pixel."""
        for some in _batches(length):
            span, within = _repeated(length, some)
            pixel = first.take(span) + within
            depth = (z.take(span) + z_x.take(span) * within).astype(np.float32)
            good = (depth >= -1) & (depth < self.depth.take(pixel))
            if self.behind is not None:
                good &= depth > self.behind.take(pixel)
            good_at = np.flatnonzero(good)
            self._keep(face.take(span.take(good_at)), pixel.take(good_at), depth.take(good_at))

    def _keep(self, face: _Index, pixel: _Index, depth: _Singles) -> None:
        """Keep the nearest of what was found at pixels; all of it is nearer than what was kept before."""
        at, left = pixel, depth
        while len(at):
            self.depth[at] = left  # of several at a pixel the last one
            nearer = np.flatnonzero(left < self.depth.take(at))
            at, left = at.take(nearer), left.take(nearer)
        won = np.flatnonzero(depth == self.depth.take(pixel))[::-1]
        self.face[pixel.take(won)] = face.take(won)


def _batches(counts: _Index) -> Iterator[slice]:
    """Yield ranges of items whose counts add up to `_AT_ONCE` at most, unless a single one has more."""
    ends = np.cumsum(counts)
    start, done, total = 0, 0, int(ends[-1]) if len(ends) else 0
    while done < total:
        stop = max(start + 1, int(np.searchsorted(ends, done + _AT_ONCE, "right")))
        yield slice(start, stop)
        start, done = stop, int(ends[stop - 1])


def _repeated(counts: _Index, some: slice) -> tuple[_Index, _Index]:
    """Return each item of a range, repeated as its count says, and 0, 1, 2 ... within each."""
    counts = counts[some]
    item = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(item))
    within -= (np.cumsum(counts) - counts).take(item)
    item += some.start
    return item, within


@dataclass(frozen=True)
class FacePlanes:
    """Planes of faces: normals (3, F), as long as twice the area, and their products with a corner, (F,)."""

    normals: _Singles
    offsets: _Singles

    @classmethod
    def of(cls, verts: _Singles, faces: _Index) -> FacePlanes:
        """Return the planes of faces (F, 3) with vertices (V, 3)."""
        a, b, c = (verts.T.take(corner, 1) for corner in faces.T)
        u, v = b - a, c - a
        normals = np.stack([u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2] for i in range(3)])
        return cls(normals, normals[0] * a[0] + normals[1] * a[1] + normals[2] * a[2])

    def heights(self, eyes: _Singles) -> _Singles:
        """Return how far each eye (B, 3) is in front of each face, times twice the area, (B, F); 0 without an area."""
        return np.asarray(eyes @ self.normals - self.offsets)


def interpolated(
    clip: NDArray[np.floating], values: _Singles, faces: _Index, pixels: _Index, face: _Index, height: int, width: int
) -> _Singles:
    """Interpolate values at covered pixels of one view.

    Parameters
    ----------
    clip : (V, 4) floating
    values : (C, V) float32
    faces : (F, 3) int64
    pixels : (P,) int64
        Flat indices into (height, width) of the covered pixels.
    face : (P,) int64
        The visible face at each of them.

    Returns
    -------
    (C, P) float32: the mean of the corners where a face is seen exactly edge-on.
    """
    row, column = np.divmod(pixels, width)
    p_x, p_y = (column + 0.5) * (2.0 / width) - 1, 1 - (row + 0.5) * (2.0 / height)
    q = []
    for corner in faces.T:
        x, y, w = (clip[:, axis].take(corner).astype(np.float64).take(face) for axis in (0, 1, 3))
        q.append((x - p_x * w, y - p_y * w))
    areas = [q[i - 2][0] * q[i - 1][1] - q[i - 2][1] * q[i - 1][0] for i in range(3)]
    total = areas[0] + areas[1] + areas[2]
    edge_on = np.flatnonzero(total == 0)
    if len(edge_on):
        total[edge_on] = 3.0
        for area in areas:
            area[edge_on] = 1.0
    weights = [(area / total).astype(np.float32) for area in areas[1:]]
    found = np.empty((len(values), len(pixels)), np.float32)
    for channel, of_channel in zip(values, found, strict=True):
        first, *others = (channel.take(corner) for corner in faces.T)
        of_channel[:] = first.take(face)
        # What is the same at all corners stays so exactly: a texel's border, for example.
        for weight, other in zip(weights, others, strict=True):
            of_channel += weight * (other - first).take(face)
    return found
