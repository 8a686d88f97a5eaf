"""Rasterise: find the nearest triangle at each pixel, and antialias silhouettes differentiably.

There is one backend per kind of device: a compiled loop on the CPU, plain torch elsewhere. Both use the same exact
integer arithmetic and therefore agree on every pixel except for ties in depth. What nobody differentiates is drawn
without torch and numba, by `visibility.py`, which sees the same in three times the time of the compiled loop.

In plain torch, (triangle, row) spans are enumerated and only covered pixels visited. The integer half-planes give the
exact span of each row, so slivers cost no more than the pixels they cover. A 64-bit key (depth, face) with an atomic
minimum makes the result independent of the order of writes.

On the CPU, a scanline loop with exact integer edge functions is compiled by numba. Vertices are snapped to 1/256 pixel.
A pixel belongs to a triangle if its centre is inside by the top-left rule, so neighbouring triangles neither overlap
nor leave gaps. Source of the edge functions: Pineda 1988, A Parallel Algorithm for Polygon Rasterization.

Interpolation
-------------
`interpolate` is perspective-correct, and differentiable in values and positions. With p the pixel in normalised
coordinates and q_i = (x_i - p_x w_i, y_i - p_y w_i), the areas a_0 = q_1 x q_2 and so on give the barycentric
coordinates b_i = a_i / (a_0 + a_1 + a_2), and the value is sum_i b_i v_i. The gradient with respect to the positions
accounts for patterns on the surface that move with it.

A face that is seen exactly edge-on can still be the nearest at a pixel, because visibility is computed on an integer
grid. Its areas then sum to zero: the three corners get equal weights, and the positions no gradient.

Source: Olano and Greer 1997, Triangle Scan Conversion using 2D Homogeneous Coordinates.

Silhouettes
-----------
`antialias` walks along each silhouette edge and blends the pixel pairs that it separates. Where a silhouette edge
crosses the line between two pixel centres, the pixel that is partly covered across the edge takes a share of the
other's colour. The share depends on the position of the crossing, a smooth function of the edge's two vertices, so the
image's gradient reaches the silhouette. The walk starts from the mesh's edges rather than from pixels whose triangles
differ. It therefore also finds silhouettes of triangles that cover no pixel centre, and gradients remain correct for
triangles smaller than a pixel.

The analytic blend follows Laine et al. 2020, Modular Primitives, section 3.4; the enumeration by edges is our own.
On the CPU the walk is one compiled pass over the edges, in float64 from the given positions. Edges are visited in their
order, and sums are added up in that order, so the same input gives the same bits. Elsewhere it is plain torch.
There is no gradient where two surfaces intersect without a common edge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.errors import ShapeError
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import edges_of
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.clay import DEPTH_BIAS
from meshdeform.rendering.visibility import EMPTY_DEPTH
from meshdeform.support.threads import in_ranges

_SUB = 256
_HALF = 128
_EMPTY = torch.iinfo(torch.int64).max
_MAX_ITEMS = 1 << 22  # rows or pixels in memory at a time; does not affect the result

_FAR = 1048576.0
"""Clamp of pixel coordinates, far off the picture."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Planes = tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]
_Box = tuple[Tensor, Tensor, Tensor, Tensor]
"""The first and the last column and row of each triangle."""


class _Shown(NamedTuple):
    """Pixels (P,) of views that show the surface, as indices into (B, height, width), and the face at each."""

    pixels: _Index
    face_of_pixel: _Index
    height: int
    width: int


class _Blends(NamedTuple):
    """What `_walk` finds: pairs of pixels with their edges, (N, 4), and shares with their derivatives, (N, 6)."""

    where: _Index
    what: _Floats


@torch.no_grad()
def rasterize_spans(
    clip: Tensor, faces: Tensor, height: int, width: int, behind: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Rasterise on `clip`'s device; see `rasterize`.

    Returns (B, H, W) int64 face indices and (B, H, W) float32 depths.
    """
    views, n_faces = clip.shape[0], faces.shape[0]
    w = clip[..., 3].double()
    ndc = clip[..., :3].double() / w[..., None].clamp_min(1e-6)
    x_all = ((ndc[..., 0] * 0.5 + 0.5) * width * _SUB).clamp(-(2.0**22), 2.0**22).round().long()
    y_all = ((0.5 - ndc[..., 1] * 0.5) * height * _SUB).clamp(-(2.0**22), 2.0**22).round().long()
    x, y = x_all[:, faces].view(-1, 3), y_all[:, faces].view(-1, 3)
    area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    left = ((x.amin(1) + _HALF - 1) >> 8).clamp_min(0)
    right = ((x.amax(1) - _HALF) >> 8).clamp_max(width - 1)
    top = ((y.amin(1) + _HALF - 1) >> 8).clamp_min(0)
    bottom = ((y.amax(1) - _HALF) >> 8).clamp_max(height - 1)
    seen = (area != 0) & (right >= left) & (bottom >= top) & (w[:, faces] > 1e-6).all(-1).view(-1)
    t = seen.nonzero()[:, 0]
    key = torch.full((views * height * width,), _EMPTY, dtype=torch.int64, device=clip.device)
    if t.numel():
        z = ndc[..., 2][:, faces].view(-1, 3)[t]
        planes, box = _edge_planes(x[t], y[t], z, area[t]), (left[t], right[t], top[t], bottom[t])
        _fill(key, t % n_faces, (t // n_faces) * height, planes, box, width, behind)
    empty = key == _EMPTY
    face_ids = torch.where(empty, -1, key & 0xFFFFFFFF)
    depth = torch.where(empty, EMPTY_DEPTH, (key >> 32).double() * 2.0**-29 - 1).float()
    return face_ids.view(views, height, width), depth.view(views, height, width)


def _edge_planes(x: Tensor, y: Tensor, z: Tensor, area: Tensor) -> _Planes:
    """Return integer edge functions a*col + b*row + c >= 0 and the depth plane of each triangle."""
    sign = area.sign()[:, None]
    xa, ya, xb, yb = x[:, [1, 2, 0]], y[:, [1, 2, 0]], x[:, [2, 0, 1]], y[:, [2, 0, 1]]
    a, b = (ya - yb) * sign, (xb - xa) * sign
    c = -(a * xa + b * ya) + _HALF * (a + b)
    inverse = 1.0 / area.abs().double()
    z_x, z_y = (a * z).sum(1) * inverse * _SUB, (b * z).sum(1) * inverse * _SUB
    z_0 = (c * z).sum(1) * inverse
    top_left = (a > 0) | ((a == 0) & (b < 0))
    return a * _SUB, b * _SUB, c - (~top_left).long(), z_x, z_y, z_0


def _fill(
    key: Tensor, face: Tensor, first_row: Tensor, planes: _Planes, box: _Box, width: int, behind: Tensor | None
) -> None:
    (a, b, c, z_x, z_y, z_0), (left, right, top, bottom) = planes, box
    rows = bottom - top + 1
    rows_end = rows.cumsum(0)
    for start, stop in _chunks(rows_end):
        i, offset = _expand(rows, rows_end, start, stop)
        row = top[i] + offset
        lo, hi = left[i], right[i]
        for q in range(3):
            slope = a[i, q]
            rest = b[i, q] * row + c[i, q]
            bound = torch.div(rest, torch.where(slope == 0, 1, slope.abs()), rounding_mode="floor")
            lo = torch.where(slope > 0, torch.maximum(lo, -bound), lo)
            hi = torch.where(slope < 0, torch.minimum(hi, bound), hi)
            hi = torch.where((slope == 0) & (rest < 0), lo - 1, hi)
        length = (hi - lo + 1).clamp_min(0)
        k = length.nonzero()[:, 0]
        i, row, lo, length = i[k], row[k], lo[k], length[k]
        length_end = length.cumsum(0)
        for start2, stop2 in _chunks(length_end):
            j, column = _expand(length, length_end, start2, stop2)
            column = column + lo[j]
            z = z_0[i[j]] + z_y[i[j]] * row[j] + z_x[i[j]] * column
            inside = (z >= -1) & (z < EMPTY_DEPTH)
            # Depths -1 .. 3 in 31 bits; with one bit more, the shifted key would become negative and always win.
            fixed = ((z.clamp(-1, EMPTY_DEPTH) + 1) * 2**29).long()
            pixel = (first_row[i[j]] + row[j]) * width + column
            if behind is not None:
                inside &= (fixed.double() * 2.0**-29 - 1).float() > behind.reshape(-1)[pixel]
            key.scatter_reduce_(0, pixel, torch.where(inside, (fixed << 32) | face[i[j]], _EMPTY), "amin")


def _chunks(ends: Tensor) -> Iterator[tuple[int, int]]:
    """Yield ranges of items whose counts (given by their running sum) add up to `_MAX_ITEMS` at most."""
    n, start, done = ends.numel(), 0, 0
    while start < n:
        stop = min(n, max(start + 1, int(torch.searchsorted(ends, done + _MAX_ITEMS, right=True))))
        yield start, stop
        start, done = stop, int(ends[stop - 1])


def _expand(counts: Tensor, ends: Tensor, start: int, stop: int) -> tuple[Tensor, Tensor]:
    """Return, for items start..stop, each index repeated `counts` times, and 0, 1, 2 ... within each."""
    done = int(ends[start - 1]) if start else 0
    total = int(ends[stop - 1]) - done
    item = torch.repeat_interleave(
        torch.arange(start, stop, device=counts.device), counts[start:stop], output_size=total
    )
    within = torch.arange(done, done + total, device=counts.device) - (ends - counts)[item]
    return item, within


@kernel
def _snapped(clip: _Floats, width: int, height: int, x: _Index, y: _Index, z: _Floats) -> None:
    """Set the positions of a view's vertices in 256ths of a pixel, and their depths, NaN behind the camera."""
    for v in range(len(clip)):
        w = clip[v, 3]
        if w <= 1e-6:
            z[v] = np.nan
            x[v] = 0
            y[v] = 0
            continue
        # Clamped so that products of coordinates fit easily into 64 bits.
        x[v] = np.int64(np.rint(min(max((clip[v, 0] / w * 0.5 + 0.5) * width * _SUB, -4194304.0), 4194304.0)))
        y[v] = np.int64(np.rint(min(max((0.5 - clip[v, 1] / w * 0.5) * height * _SUB, -4194304.0), 4194304.0)))
        z[v] = clip[v, 2] / w


@kernel
def _late(a: int, b: int) -> int:
    """Return 1 for an edge whose pixel centres belong to the neighbour, by the rule of top and left edges; else 0."""
    return 0 if a > 0 or (a == 0 and b < 0) else 1


@kernel
def _rasterize(
    clip: NDArray[np.float64],
    faces: NDArray[np.int64],
    face_ids: NDArray[np.int64],
    depth: NDArray[np.float32],
    behind: NDArray[np.float32] | None,
) -> None:
    views, n_verts = clip.shape[0], clip.shape[1]
    height, width = face_ids.shape[1], face_ids.shape[2]
    x = np.empty(n_verts, np.int64)
    y = np.empty(n_verts, np.int64)
    z = np.empty(n_verts, np.float64)
    for b in range(views):
        _snapped(clip[b], width, height, x, y, z)
        for f in range(faces.shape[0]):
            i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
            area = (x[j] - x[i]) * (y[k] - y[i]) - (x[k] - x[i]) * (y[j] - y[i])
            if area == 0 or np.isnan(z[i] + z[j] + z[k]):
                continue
            if area < 0:
                j, k = k, j
                area = -area
            top = max(0, (min(y[i], y[j], y[k]) + _HALF - 1) >> 8)
            bottom = min(height - 1, (max(y[i], y[j], y[k]) - _HALF) >> 8)
            left = max(0, (min(x[i], x[j], x[k]) + _HALF - 1) >> 8)
            right = min(width - 1, (max(x[i], x[j], x[k]) - _HALF) >> 8)
            if top > bottom or left > right:
                continue
            px, py = left * _SUB + _HALF, top * _SUB + _HALF
            ax, ay, az = y[j] - y[k], y[k] - y[i], y[i] - y[j]
            bx, by, bz = x[k] - x[j], x[i] - x[k], x[j] - x[i]
            e0 = ax * (px - x[j]) + bx * (py - y[j])
            e1 = ay * (px - x[k]) + by * (py - y[k])
            e2 = az * (px - x[i]) + bz * (py - y[i])
            inverse = 1.0 / area
            dz_dx = (ax * z[i] + ay * z[j] + az * z[k]) * inverse * _SUB
            dz_dy = (bx * z[i] + by * z[j] + bz * z[k]) * inverse * _SUB
            z_row = (e0 * z[i] + e1 * z[j] + e2 * z[k]) * inverse
            e0, e1, e2 = e0 - _late(ax, bx), e1 - _late(ay, by), e2 - _late(az, bz)
            for row in range(top, bottom + 1):
                g0, g1, g2, depth_here = e0, e1, e2, z_row
                for column in range(left, right + 1):
                    if (g0 | g1 | g2) >= 0:
                        d = np.float32(depth_here)
                        # Compiled once without `behind` and once with it: numba removes the branch.
                        hidden = False
                        if behind is not None:
                            hidden = d <= behind[b, row, column]
                        if d < depth[b, row, column] and d >= -1.0 and not hidden:
                            depth[b, row, column] = d
                            face_ids[b, row, column] = f
                    g0 += ax * _SUB
                    g1 += ay * _SUB
                    g2 += az * _SUB
                    depth_here += dz_dx
                e0 += bx * _SUB
                e1 += by * _SUB
                e2 += bz * _SUB
                z_row += dz_dy


def rasterize_compiled(
    clip: Tensor, faces: Tensor, height: int, width: int, behind: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Rasterise on the CPU; see `rasterize`.

    Returns (B, H, W) int64 face indices and (B, H, W) float32 depths.
    """
    face_ids = torch.full((clip.shape[0], height, width), -1, dtype=torch.int64)
    depth = torch.full((clip.shape[0], height, width), EMPTY_DEPTH, dtype=torch.float32)
    limit = None if behind is None else behind.contiguous().numpy()
    points, corners, ids, depths = (
        clip.double().contiguous().numpy(),
        faces.contiguous().numpy(),
        face_ids.numpy(),
        depth.numpy(),
    )

    def draw(begin: int, end: int) -> None:
        views = slice(begin, end)
        _rasterize(points[views], corners, ids[views], depths[views], None if limit is None else limit[views])

    in_ranges(draw, len(points))
    return face_ids, depth


def interpolate(
    clip: Tensor, values: Tensor, faces: Tensor, pixels: Tensor, face_of_pixel: Tensor, height: int, width: int
) -> Tensor:
    """Interpolate values at covered pixels.

    Parameters
    ----------
    clip : (B, V, 4) float32
    values : (B, V, C) float32
    faces : (F, 3) int64
    pixels : (P,) int64
        Flat indices into (B, height, width) of the covered pixels.
    face_of_pixel : (P,) int64
        The visible face at each pixel.

    Returns
    -------
    (P, C) float32
    """
    if is_compiled(clip):
        result: Tensor = _Interpolate.apply(clip, values, faces, pixels, face_of_pixel, height, width)  # type: ignore[no-untyped-call]
        return result
    return interpolate_torch(clip, values, faces, pixels, face_of_pixel, height, width)


def interpolate_torch(
    clip: Tensor, values: Tensor, faces: Tensor, pixels: Tensor, face_of_pixel: Tensor, height: int, width: int
) -> Tensor:
    """Interpolate in plain torch, on any device; see `interpolate`.

    The areas are computed in float64 as in the compiled loop: x - p w suffers cancellation, and in float32 the
    gradients of small faces are wrong by several percent.
    """
    view = torch.div(pixels, height * width, rounding_mode="floor")
    within = pixels % (height * width)
    x = ((within % width).double() + 0.5) * (2.0 / width) - 1
    y = 1 - (torch.div(within, width, rounding_mode="floor").double() + 0.5) * (2.0 / height)
    index = (view[:, None] * clip.shape[1] + faces[face_of_pixel]).reshape(-1)
    p = clip.reshape(-1, 4).index_select(0, index).view(-1, 3, 4).double()
    q = p[..., :2] - torch.stack([x, y], -1)[:, None] * p[..., 3:]
    j, k = q[:, [1, 2, 0]], q[:, [2, 0, 1]]
    area = j[..., 0] * k[..., 1] - j[..., 1] * k[..., 0]
    total = area.sum(-1, keepdim=True)
    flat = total == 0
    # Two selections, because the gradient of a quotient by zero would be NaN even where its value is unused.
    weights = torch.where(flat, 1 / 3, area / torch.where(flat, 1.0, total))
    corner = values.reshape(-1, values.shape[-1]).index_select(0, index).view(-1, 3, values.shape[-1])
    return (corner.double() * weights[..., None]).sum(1).to(values.dtype)


@kernel
def _forward(clip, values, faces, shown, weights, out):  # type: ignore[no-untyped-def]
    height, width = shown.height, shown.width
    for n in range(len(shown.pixels)):
        b, within = divmod(shown.pixels[n], height * width)
        row, column = divmod(within, width)
        px, py = (column + 0.5) * (2.0 / width) - 1.0, 1.0 - (row + 0.5) * (2.0 / height)
        f = faces[shown.face_of_pixel[n]]
        x0, y0 = clip[b, f[0], 0] - px * clip[b, f[0], 3], clip[b, f[0], 1] - py * clip[b, f[0], 3]
        x1, y1 = clip[b, f[1], 0] - px * clip[b, f[1], 3], clip[b, f[1], 1] - py * clip[b, f[1], 3]
        x2, y2 = clip[b, f[2], 0] - px * clip[b, f[2], 3], clip[b, f[2], 1] - py * clip[b, f[2], 3]
        a0, a1, a2 = x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1
        total = a0 + a1 + a2
        if total == 0.0:
            a0, a1, a2, total = 1.0, 1.0, 1.0, 3.0
        inverse = 1.0 / total
        weights[n, 0], weights[n, 1], weights[n, 2] = a0 * inverse, a1 * inverse, a2 * inverse
        for c in range(values.shape[2]):
            out[n, c] = (a0 * values[b, f[0], c] + a1 * values[b, f[1], c] + a2 * values[b, f[2], c]) * inverse


@kernel
def _backward(clip, values, faces, shown, weights, grad, d_clip, d_values):  # type: ignore[no-untyped-def]
    height, width = shown.height, shown.width
    x = np.empty(3)
    y = np.empty(3)
    g = np.empty(3)
    for n in range(len(shown.pixels)):
        b, within = divmod(shown.pixels[n], height * width)
        row, column = divmod(within, width)
        px, py = (column + 0.5) * (2.0 / width) - 1.0, 1.0 - (row + 0.5) * (2.0 / height)
        f = faces[shown.face_of_pixel[n]]
        mean = 0.0
        for i in range(3):
            x[i] = clip[b, f[i], 0] - px * clip[b, f[i], 3]
            y[i] = clip[b, f[i], 1] - py * clip[b, f[i], 3]
            g[i] = 0.0
            for c in range(values.shape[2]):
                d_values[b, f[i], c] += weights[n, i] * grad[n, c]
                g[i] += grad[n, c] * values[b, f[i], c]
            mean += g[i] * weights[n, i]
        total = x[1] * y[2] - y[1] * x[2] + x[2] * y[0] - y[2] * x[0] + x[0] * y[1] - y[0] * x[1]
        if total == 0.0:
            continue
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            # a_i = x_j y_k - y_j x_k
            d_area = (g[i] - mean) / total
            for corner, dx, dy in ((j, d_area * y[k], -d_area * x[k]), (k, -d_area * y[j], d_area * x[j])):
                d_clip[b, f[corner], 0] += dx
                d_clip[b, f[corner], 1] += dy
                d_clip[b, f[corner], 3] -= px * dx + py * dy


class _Interpolate(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: FunctionCtx,
        clip: Tensor,
        values: Tensor,
        faces: Tensor,
        pixels: Tensor,
        face_of_pixel: Tensor,
        height: int,
        width: int,
    ) -> Tensor:
        arrays = [t.detach().contiguous().numpy() for t in (clip, values, faces)]
        at, owner = (t.detach().contiguous().numpy() for t in (pixels, face_of_pixel))
        shown = _Shown(at, owner, height, width)
        weights = np.empty((len(pixels), 3))
        out = np.empty((len(pixels), values.shape[2]), arrays[1].dtype)
        _forward(*arrays, shown, weights, out)  # type: ignore[no-untyped-call, call-arg]
        ctx.saved = (arrays, shown, weights)  # type: ignore[attr-defined]
        return torch.from_numpy(out)

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, grad: Tensor) -> tuple[Tensor | None, ...]:
        arrays, shown, weights = ctx.saved  # type: ignore[attr-defined]
        d_clip, d_values = np.zeros(arrays[0].shape), np.zeros(arrays[1].shape)
        _backward(*arrays, shown, weights, grad.contiguous().numpy(), d_clip, d_values)  # type: ignore[no-untyped-call, call-arg]
        as_clip = torch.from_numpy(d_clip.astype(arrays[0].dtype))
        return as_clip, torch.from_numpy(d_values.astype(arrays[1].dtype)), None, None, None, None, None


@kernel
def _walk(
    clip: _Floats, ends: _Index, opposite: _Index, depth: NDArray[np.float32], removed: NDArray[np.float32] | None
) -> tuple[_Index, _Floats]:
    """Find the visible crossings, of several between two pixels the nearest."""
    # (N, 4) int64: the pixel that takes a share of another's colour, that other pixel, the rows of the edge's ends.
    # (N, 6) float64: the share, its derivatives by the two pixel coordinates of each end, the depth of the edge.
    views, n_verts = clip.shape[0], clip.shape[1]
    height, width = depth.shape[1], depth.shape[2]
    x, y = np.empty(n_verts), np.empty(n_verts)
    # The crossing of each pixel with its right-hand and its lower neighbour.
    owners = np.full(views * height * width * 2, -1, np.int32)
    where = np.empty((256, 4), np.int64)
    what = np.empty((256, 6))
    count = 0
    deep = depth.ravel()
    for view in range(views):
        for v in range(n_verts):
            w = clip[view, v, 3]
            if w > 1e-6:
                x[v] = (clip[view, v, 0] / w + 1) * (width * 0.5)
                y[v] = (1 - clip[view, v, 1] / w) * (height * 0.5)
            else:
                x[v] = y[v] = np.nan
        for e in range(len(ends)):
            i, j = ends[e, 0], ends[e, 1]
            dx, dy = x[j] - x[i], y[j] - y[i]
            k = opposite[e, 0]
            first = dx * (y[k] - y[i]) - dy * (x[k] - x[i])
            second, k = first, opposite[e, 1]
            if k >= 0:
                second = dx * (y[k] - y[i]) - dy * (x[k] - x[i])
            # A vertex behind the camera has no position in the picture, and faces with one are not drawn.
            if not first * second > 0:
                continue
            by_row = abs(dy) >= abs(dx)
            # u runs along the pixel pair, v along the walk.
            ui, uj, vi, vj = (x[i], x[j], y[i], y[j]) if by_row else (y[i], y[j], x[i], x[j])
            lines, limit = (height, width) if by_row else (width, height)
            plus = (-dy if by_row else dx) * first > 0
            begin = int(min(max(np.ceil(min(vi, vj) - 0.5), 0.0), _FAR))
            end = min(int(min(max(np.ceil(max(vi, vj) - 0.5), -1.0), _FAR)) - 1, lines - 1)
            slope = (uj - ui) / (vj - vi) if end >= begin else 0.0
            zi, zj = clip[view, i, 2] / clip[view, i, 3], clip[view, j, 2] / clip[view, j, 3]
            for line in range(begin, end + 1):
                t = (line + 0.5 - vi) / (vj - vi)
                u = ui + t * (uj - ui)
                at = int(np.floor(min(max(u - 0.5, -2.0), _FAR)))
                if at < 0 or at + 1 >= limit:
                    continue
                base, stride = (
                    ((view * height + line) * width + at, 1) if by_row else ((view * height + at) * width + line, width)
                )
                inside, outside = (base + stride, base) if plus else (base, base + stride)
                z = zi + t * (zj - zi)
                # The edge must be nearer than the surface beyond it.
                hidden = not deep[outside] > z + DEPTH_BIAS
                # Compiled once without `removed` and once with it: numba removes the branch.
                if removed is not None:
                    hidden |= not z > (removed.ravel()[inside] + deep[inside]) / 2
                if hidden:
                    continue
                pair = base * 2 + (1 if by_row else 0)
                n = owners[pair]
                if n < 0:
                    n = count
                    if n == len(where):
                        where = np.concatenate((where, np.empty_like(where)))
                        what = np.concatenate((what, np.empty_like(what)))
                    owners[pair] = n
                    count += 1
                elif what[n, 5] <= z:
                    continue
                direction = -1.0 if plus else 1.0
                share = (u - ((at + 1 if plus else at) + 0.5)) * direction - 0.5
                spills = share > 0
                where[n, 0], where[n, 1] = (outside, inside) if spills else (inside, outside)
                where[n, 2], where[n, 3] = view * n_verts + i, view * n_verts + j
                what[n, 0], what[n, 5] = abs(share), z
                by_u = direction * np.sign(share)
                by_x, by_y = (by_u, -slope * by_u) if by_row else (-slope * by_u, by_u)
                what[n, 1], what[n, 2] = (1 - t) * by_x, (1 - t) * by_y
                what[n, 3], what[n, 4] = t * by_x, t * by_y
    return where[:count], what[:count]


def _crossings_of(
    clip: _Floats, ends: _Index, opposite: _Index, depth: NDArray[np.float32], removed: NDArray[np.float32] | None
) -> _Blends:
    """Share the views of `_walk` among threads."""

    def walk(begin: int, end: int) -> tuple[_Index, _Floats]:
        views = slice(begin, end)
        where, what = _walk(clip[views], ends, opposite, depth[views], None if removed is None else removed[views])
        where[:, :2] += begin * depth.shape[1] * depth.shape[2]
        where[:, 2:] += begin * clip.shape[1]
        return where, what

    where, what = zip(*in_ranges(walk, len(clip)), strict=True)
    return _Blends(where[0], what[0]) if len(where) == 1 else _Blends(np.concatenate(where), np.concatenate(what))


@kernel
def _blend(flat: _Floats, blends: _Blends, out: _Floats) -> None:
    where, what = blends.where, blends.what
    for n in range(len(where)):
        target, source = where[n, 0], where[n, 1]
        for c in range(flat.shape[1]):
            out[target, c] += what[n, 0] * (flat[source, c] - flat[target, c])


@kernel
def _blend_backward(
    flat: _Floats,
    clip: _Floats,
    blends: _Blends,
    gradient: _Floats,
    height: int,
    width: int,
    d_flat: _Floats,
    d_clip: _Floats,
) -> None:
    """Add to the gradients of the picture (P, C) and of the positions (B * V, 4)."""
    where, what = blends.where, blends.what
    for n in range(len(where)):
        target, source = where[n, 0], where[n, 1]
        d_share = 0.0
        for c in range(flat.shape[1]):
            passed = what[n, 0] * gradient[target, c]
            d_flat[source, c] += passed
            d_flat[target, c] -= passed
            d_share += gradient[target, c] * (flat[source, c] - flat[target, c])
        for end in range(2):
            v = where[n, 2 + end]
            w = clip[v, 3]
            d_x = d_share * what[n, 1 + 2 * end] * (width * 0.5) / w
            d_y = -d_share * what[n, 2 + 2 * end] * (height * 0.5) / w
            d_clip[v, 0] += d_x
            d_clip[v, 1] += d_y
            d_clip[v, 3] -= (d_x * clip[v, 0] + d_y * clip[v, 1]) / w


def antialias_compiled(
    image: Tensor, clip: Tensor, ends: Tensor, opposite: Tensor, depth: Tensor, removed: Tensor | None = None
) -> Tensor:
    """Blend on the CPU; see `antialias`, whose `edges` are the two (E, 2) here."""
    result: Tensor = _Antialias.apply(image, clip, ends, opposite, depth, removed)  # type: ignore[no-untyped-call]
    return result


class _Antialias(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: FunctionCtx,
        image: Tensor,
        clip: Tensor,
        ends: Tensor,
        opposite: Tensor,
        depth: Tensor,
        removed: Tensor | None,
    ) -> Tensor:
        flat, points = image.detach().reshape(-1, image.shape[-1]).numpy(), clip.detach().contiguous().numpy()
        limit = None if removed is None else removed.contiguous().numpy()
        blends = _crossings_of(
            points, ends.contiguous().numpy(), opposite.contiguous().numpy(), depth.contiguous().numpy(), limit
        )
        out = flat.copy()
        _blend(flat, blends, out)
        ctx.saved = (flat, points, blends, depth.shape[1:])  # type: ignore[attr-defined]
        return torch.from_numpy(out).view(image.shape)

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor | None, ...]:
        flat, points, blends, (height, width) = ctx.saved  # type: ignore[attr-defined]
        incoming = gradient.contiguous().numpy().reshape(flat.shape)
        d_flat, d_clip = incoming.copy(), np.zeros((points.shape[0] * points.shape[1], 4))
        _blend_backward(flat, points.reshape(-1, 4), blends, incoming, height, width, d_flat, d_clip)
        as_clip = torch.from_numpy(d_clip.astype(points.dtype)).view(points.shape)
        return torch.from_numpy(d_flat).view(gradient.shape), as_clip, None, None, None, None


@dataclass(frozen=True)
class SilhouetteEdges:
    """Edges of the mesh with the opposite vertices of their faces."""

    verts: Tensor  # (E, 2) int64: end points
    opposite: Tensor
    """(E, 2) int64: third vertex of the edge's first and second face; -1 if there is no second one (open borders)."""


def antialias(
    image: Tensor, clip: Tensor, edges: SilhouetteEdges, depth: Tensor, removed: Tensor | None = None
) -> Tensor:
    """Blend pixel pairs across silhouettes, differentiably in `clip` and `image`.

    `image` is (B, H, W, C) floating; `clip`, (B, V, 4) floating: the rasterised vertices; `depth`, (B, H, W) float32:
    from `rasterize`: of the surface that is seen; `removed`, (B, H, W) float32: depth of the farthest surface in front
    of it that is cut out there, -inf where there is none: the edges of that surface separate nothing. Returns (B, H, W,
    C), the antialiased image.
    """
    if is_compiled(clip):
        return antialias_compiled(image, clip, edges.verts, edges.opposite, depth, removed)
    height, width, channels = image.shape[1:]
    ndc = clip[..., :2] / clip[..., 3:]
    pixels = torch.stack([(ndc[..., 0] + 1) * (width * 0.5), (1 - ndc[..., 1]) * (height * 0.5)], -1)
    crossing = _crossings(pixels.detach(), clip.detach(), edges, height, width)
    n_verts = clip.shape[1]
    flat_pixels = pixels.reshape(-1, 2)
    a = flat_pixels.index_select(0, crossing.view * n_verts + edges.verts[crossing.edge, 0])
    b = flat_pixels.index_select(0, crossing.view * n_verts + edges.verts[crossing.edge, 1])
    # u runs along the pixel pair, v along the walk.
    by_row = crossing.by_row[:, None]
    a, b = torch.where(by_row, a, a.flip(-1)), torch.where(by_row, b, b.flip(-1))
    t = (crossing.line.to(a.dtype) + 0.5 - a[:, 1]) / (b[:, 1] - a[:, 1])
    u = a[:, 0] + t * (b[:, 0] - a[:, 0])
    chosen = _visible(u.detach(), t.detach(), crossing, clip.detach(), edges, depth, removed)
    share = (u[chosen.index] - (chosen.inside_at.to(u.dtype) + 0.5)) * chosen.direction - 0.5
    spills = share.detach() > 0
    target = torch.where(spills, chosen.outside, chosen.inside)
    source = torch.where(spills, chosen.inside, chosen.outside)
    flat = image.reshape(-1, channels)
    blend = share.abs()[:, None] * (flat.index_select(0, source) - flat.index_select(0, target))
    return flat.index_add(0, target, blend).view(image.shape)


@dataclass(frozen=True)
class _Crossings:
    """Crossings of silhouette edges with lines of pixel centres (rows if the edge is steep, otherwise columns)."""

    view: Tensor
    edge: Tensor
    by_row: Tensor
    line: Tensor
    inside_is_plus: Tensor


@torch.no_grad()
def _crossings(pixels: Tensor, clip: Tensor, edges: SilhouetteEdges, height: int, width: int) -> _Crossings:
    pa, pb = pixels[:, edges.verts[:, 0]], pixels[:, edges.verts[:, 1]]
    along = pb - pa

    def side(opposite: Tensor) -> Tensor:
        q = pixels[:, opposite.clamp_min(0)] - pa
        return along[..., 0] * q[..., 1] - along[..., 1] * q[..., 0]

    first = side(edges.opposite[:, 0])
    second = torch.where(edges.opposite[:, 1] < 0, first, side(edges.opposite[:, 1]))
    in_front = (clip[..., 3] > 1e-6)[:, edges.verts].all(-1)
    view, edge = ((first * second > 0) & in_front).nonzero(as_tuple=True)
    a, b, along = pa[view, edge], pb[view, edge], along[view, edge]
    side_of_mesh = first[view, edge].sign()
    by_row = along[:, 1].abs() >= along[:, 0].abs()
    start = torch.where(by_row, a[:, 1], a[:, 0])
    stop = torch.where(by_row, b[:, 1], b[:, 0])
    lines = torch.where(by_row, height, width)
    low = torch.ceil(torch.minimum(start, stop) - 0.5).clamp_min(0).clamp_max(2**20).long()
    high = torch.minimum(torch.ceil(torch.maximum(start, stop) - 0.5).clamp(-1, 2**20).long() - 1, lines - 1)
    counts = (high - low + 1).clamp_min(0)
    total = int(counts.sum())
    i = torch.repeat_interleave(torch.arange(counts.numel(), device=counts.device), counts, output_size=total)
    line = low[i] + torch.arange(total, device=counts.device) - (counts.cumsum(0) - counts)[i]
    plus = torch.where(by_row, -along[:, 1], along[:, 0]) * side_of_mesh > 0
    return _Crossings(view[i], edge[i], by_row[i], line, plus[i])


@dataclass(frozen=True)
class _Chosen:
    """Visible crossings: the nearest one of each pixel pair."""

    index: Tensor
    inside: Tensor
    outside: Tensor
    inside_at: Tensor
    direction: Tensor


@torch.no_grad()
def _visible(
    u: Tensor,
    t: Tensor,
    crossing: _Crossings,
    clip: Tensor,
    edges: SilhouetteEdges,
    depth: Tensor,
    removed: Tensor | None,
) -> _Chosen:
    height, width = depth.shape[1:]
    at = torch.floor(u - 0.5).clamp(-2, 2**20).long()
    limit = torch.where(crossing.by_row, width, height)
    inside_at = torch.where(crossing.inside_is_plus, at + 1, at)
    outside_at = torch.where(crossing.inside_is_plus, at, at + 1)
    on_screen = (at >= 0) & (at + 1 < limit)

    def pixel(position: Tensor) -> Tensor:
        row = torch.where(crossing.by_row, crossing.line, position)
        column = torch.where(crossing.by_row, position, crossing.line)
        return torch.where(on_screen, (crossing.view * height + row) * width + column, 0)

    inside, outside = pixel(inside_at), pixel(outside_at)
    z = clip[..., 2] / clip[..., 3]
    z_a, z_b = z[crossing.view, edges.verts[crossing.edge, 0]], z[crossing.view, edges.verts[crossing.edge, 1]]
    z_edge = z_a + t * (z_b - z_a)
    # The edge must be nearer than the surface beyond it; of several edges between two pixels, the nearest wins.
    seen = on_screen & (depth.reshape(-1)[outside] > z_edge + DEPTH_BIAS)
    if removed is not None:
        seen &= z_edge > (removed.reshape(-1)[inside] + depth.reshape(-1)[inside]) / 2
    index = seen.nonzero()[:, 0]
    pair = torch.minimum(inside[index], outside[index]) * 2 + crossing.by_row[index].long()
    fixed = ((z_edge[index].double().clamp(-1, EMPTY_DEPTH) + 1) * 2**29).long()
    rank = (fixed << 31) | torch.arange(index.numel(), device=index.device)
    best = torch.full((depth.numel() * 2,), _EMPTY, dtype=torch.int64, device=index.device)
    best.scatter_reduce_(0, pair, rank, "amin")
    index = index[best[pair] == rank]
    direction = torch.where(crossing.inside_is_plus[index], -1.0, 1.0).to(u.dtype)
    return _Chosen(index, inside[index], outside[index], inside_at[index], direction)


@dataclass(frozen=True)
class Fragments:
    """The nearest triangle at each pixel centre."""

    face_ids: Tensor
    """(B, H, W) int64: index of the face, -1 where there is none. Row 0 is the top of the image."""
    depth: Tensor
    """(B, H, W) float32: normalised device depth: -1 at the near plane, 1 at the far one, above 1 beyond it;
    `EMPTY_DEPTH` where there is no face."""


def rasterize(clip: Tensor, faces: Tensor, height: int, width: int, behind: Tensor | None = None) -> Fragments:
    """Find the nearest triangle at each pixel centre; triangles are two-sided.

    Triangles with a vertex at or behind the camera plane are dropped. The result is not differentiable: gradients come
    from shading on the visible surface and from `antialias` at silhouettes.

    Parameters
    ----------
    clip : (B, V, 4) floating
        Vertex positions in clip space (x right, y up).
    faces : (F, 3) int64
    behind : (B, H, W) float32, optional
        Depth of each pixel up to which triangles are ignored, to find the next layer of a transparent surface.

    Raises
    ------
    ShapeError
        `clip` is not (B, V, 4) or `faces` not (F, 3).
    """
    if clip.ndim != 3 or clip.shape[2] != 4 or faces.ndim != 2 or faces.shape[1] != 3:
        raise ShapeError(f"expected clip (B, V, 4) and faces (F, 3), got {tuple(clip.shape)} and {tuple(faces.shape)}")
    if is_compiled(clip):
        return Fragments(*rasterize_compiled(clip.detach(), faces, height, width, behind))

    return Fragments(*rasterize_spans(clip.detach(), faces, height, width, behind))


def is_compiled(tensor: Tensor) -> bool:
    """Return whether what is drawn from this tensor is drawn by compiled loops; tests and benchmarks replace this."""
    return tensor.device.type == "cpu"


def projected(verts: Tensor, cameras: Cameras) -> Tensor:
    """Return the positions (B, V, 4) of vertices (V, 3) in the views' clip space."""
    matrices = torch.from_numpy(cameras.view_proj).to(verts)
    return verts @ matrices[:, :, :3].mT + matrices[:, None, :, 3]


class CoverageRenderer:
    """Draws the silhouettes of the deformed states of one mesh.

    Parameters
    ----------
    faces : (F, 3) int64
        The fixed topology.
    side : int
        Side of a picture in pixels.
    """

    def __init__(self, faces: Tensor, n_verts: int, side: int, device: torch.device | str = "cpu") -> None:
        edges = edges_of(faces.cpu().numpy())
        self.side = side
        self._n_verts = n_verts
        self._faces = faces.to(device)
        self._edges = SilhouetteEdges(*(torch.from_numpy(each).to(device) for each in (edges.edges, edges.opposite)))

    def render(self, verts: Tensor, cameras: Cameras) -> Tensor:
        """Draw the mesh from every camera.

        Parameters
        ----------
        verts : (V, 3) floating
            Deformed positions in the cameras' frame.
        cameras : Cameras
            B cameras.

        Returns
        -------
        (B, side, side) of the vertices' type in [0, 1], the covered share of each pixel, differentiable in `verts`
        through the silhouettes.

        Raises
        ------
        ShapeError
            `verts` is not (n_verts, 3).
        """
        if verts.shape != (self._n_verts, 3):
            raise ShapeError(f"expected verts ({self._n_verts}, 3), got {tuple(verts.shape)}")
        clip = projected(verts, cameras)
        fragments = rasterize(clip, self._faces, self.side, self.side)
        covered = (fragments.face_ids >= 0).to(verts.dtype)[..., None]
        return antialias(covered, clip, self._edges, fragments.depth)[..., 0]
