"""Rasterise on the CPU: a scanline loop with exact integer edge functions, compiled by numba.

Vertices are snapped to 1/256 pixel. A pixel belongs to a triangle if its centre is inside by the top-left rule, so
neighbouring triangles neither overlap nor leave gaps. Source of the edge functions: Pineda 1988, A Parallel Algorithm
for Polygon Rasterization.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.geometry.kernels import kernel
from meshdeform.rendering.rasterizer.spans import EMPTY_DEPTH
from meshdeform.support.threads import in_ranges

__all__ = ["rasterize_compiled"]

_SUB = 256
_HALF = 128


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
        for v in range(n_verts):
            w = clip[b, v, 3]
            if w <= 1e-6:
                z[v] = np.nan
                x[v] = 0
                y[v] = 0
                continue
            # Clamped so that products of coordinates fit easily into 64 bits.
            x[v] = np.int64(np.rint(min(max((clip[b, v, 0] / w * 0.5 + 0.5) * width * _SUB, -4194304.0), 4194304.0)))
            y[v] = np.int64(np.rint(min(max((0.5 - clip[b, v, 1] / w * 0.5) * height * _SUB, -4194304.0), 4194304.0)))
            z[v] = clip[b, v, 2] / w
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
            # Top-left rule: pixel centres exactly on any other edge belong to the neighbour.
            if not (ax > 0 or (ax == 0 and bx < 0)):
                e0 -= 1
            if not (ay > 0 or (ay == 0 and by < 0)):
                e1 -= 1
            if not (az > 0 or (az == 0 and bz < 0)):
                e2 -= 1
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
    """Rasterise on the CPU; see `meshdeform.rendering.rasterizer.rasterize`.

    Returns
    -------
    (B, H, W) int64 face indices and (B, H, W) float32 depths.
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
