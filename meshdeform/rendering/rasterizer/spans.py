"""Rasterise in plain torch on any device: enumerate (triangle, row) spans and visit only covered pixels.

The integer half-planes give the exact span of each row, so slivers cost no more than the pixels they cover. A 64-bit
key (depth, face) with an atomic minimum makes the result independent of the order of writes.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

__all__ = ["EMPTY_DEPTH", "rasterize_spans"]

EMPTY_DEPTH = 3.0
"""Depth where there is no face: greater than that of any point in front of the cameras, even past the far plane."""

_SUB = 256
_HALF = 128
_EMPTY = torch.iinfo(torch.int64).max
_MAX_ITEMS = 1 << 22  # rows or pixels in memory at a time; does not affect the result


@torch.no_grad()
def rasterize_spans(
    clip: Tensor, faces: Tensor, height: int, width: int, behind: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Rasterise on `clip`'s device; see `meshdeform.rendering.rasterizer.rasterize`.

    Returns
    -------
    (B, H, W) int64 face indices and (B, H, W) float32 depths.
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
        planes = _edge_planes(x[t], y[t], z, area[t])
        _fill(key, t % n_faces, (t // n_faces) * height, planes, left[t], right[t], top[t], bottom[t], width, behind)
    empty = key == _EMPTY
    face_ids = torch.where(empty, -1, key & 0xFFFFFFFF)
    depth = torch.where(empty, EMPTY_DEPTH, (key >> 32).double() * 2.0**-29 - 1).float()
    return face_ids.view(views, height, width), depth.view(views, height, width)


_Planes = tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]


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
    key: Tensor,
    face: Tensor,
    first_row: Tensor,
    planes: _Planes,
    left: Tensor,
    right: Tensor,
    top: Tensor,
    bottom: Tensor,
    width: int,
    behind: Tensor | None,
) -> None:
    a, b, c, z_x, z_y, z_0 = planes
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
