"""Rasterise: find the nearest triangle at each pixel.

There is one backend per kind of device: a compiled loop on the CPU, plain torch elsewhere. Both use the same exact
integer arithmetic and therefore agree on every pixel except for ties in depth. What nobody differentiates is drawn
without torch and numba, by `visibility.py`, which sees the same in three times the time of the compiled loop.

In plain torch, (triangle, row) spans are enumerated and only covered pixels visited. The integer half-planes give the
exact span of each row, so slivers cost no more than the pixels they cover. A 64-bit key (depth, face) with an atomic
minimum makes the result independent of the order of writes.

On the CPU, a scanline loop with exact integer edge functions is compiled by numba. Vertices are snapped to 1/256 pixel.
A pixel belongs to a triangle if its centre is inside by the top-left rule, so neighbouring triangles neither overlap
nor leave gaps. Source of the edge functions: Pineda 1988, A Parallel Algorithm for Polygon Rasterization.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.geometry.kernels import kernel
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.visibility import EMPTY_DEPTH
from meshdeform.support.threads import in_ranges

_SUB = 256
_HALF = 128
_EMPTY = torch.iinfo(torch.int64).max
_MAX_ITEMS = 1 << 22  # rows or pixels in memory at a time; does not affect the result


_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Planes = tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]
_Box = tuple[Tensor, Tensor, Tensor, Tensor]
"""The first and the last column and row of each triangle."""


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
