"""Antialias silhouettes on the CPU: the walk of `antialias`, in one compiled pass over the edges.

Everything is computed in float64 from the given positions. Edges are visited in their order, and sums are added up in
that order, so the same input gives the same bits.
"""

from __future__ import annotations

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

__all__ = ["antialias_compiled"]

_DEPTH_BIAS = 1e-4
_FAR = 1048576.0
"""Clamp of pixel coordinates, far off the picture."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _walk(
    clip: _Floats,
    ends: _Index,
    opposite: _Index,
    depth: NDArray[np.float32],
    removed: NDArray[np.float32] | None,
) -> tuple[_Index, _Floats]:
    """Find the visible crossings, of several between two pixels the nearest.

    Returns
    -------
    (N, 4) int64
        Pixel that takes a share of another's colour, that other pixel, and the rows of the edge's ends in (B * V).
    (N, 6) float64
        The share, and its derivatives by the two pixel coordinates of each end; last, the depth of the edge.
    """
    views, n_verts = clip.shape[0], clip.shape[1]
    height, width = depth.shape[1], depth.shape[2]
    x, y = np.empty(n_verts), np.empty(n_verts)
    # The crossing of each pixel with its right-hand and its lower neighbour.
    taken = np.full(views * height * width * 2, -1, np.int32)
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
            # A vertex behind the camera has no place in the picture, and faces with one are not drawn.
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
                    ((view * height + line) * width + at, 1)
                    if by_row
                    else (
                        (view * height + at) * width + line,
                        width,
                    )
                )
                inside, outside = (base + stride, base) if plus else (base, base + stride)
                z = zi + t * (zj - zi)
                # The edge must be nearer than the surface beyond it.
                hidden = not deep[outside] > z + _DEPTH_BIAS
                # Compiled once without `removed` and once with it: numba removes the branch.
                if removed is not None:
                    hidden |= not z > (removed.ravel()[inside] + deep[inside]) / 2
                if hidden:
                    continue
                pair = base * 2 + (1 if by_row else 0)
                n = taken[pair]
                if n < 0:
                    n = count
                    if n == len(where):
                        where = np.concatenate((where, np.empty_like(where)))
                        what = np.concatenate((what, np.empty_like(what)))
                    taken[pair] = n
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


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _blend(flat: _Floats, where: _Index, what: _Floats, out: _Floats) -> None:
    for n in range(len(where)):
        target, source = where[n, 0], where[n, 1]
        for c in range(flat.shape[1]):
            out[target, c] += what[n, 0] * (flat[source, c] - flat[target, c])


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _backward(
    flat: _Floats,
    clip: _Floats,
    where: _Index,
    what: _Floats,
    gradient: _Floats,
    height: int,
    width: int,
    d_flat: _Floats,
    d_clip: _Floats,
) -> None:
    """Add to the gradients of the picture (P, C) and of the positions (B * V, 4)."""
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
    """Blend on the CPU; see `meshdeform.rendering.rasterizer.antialias`, whose `edges` are the two (E, 2) here."""
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
        where, what = _walk(
            points, ends.contiguous().numpy(), opposite.contiguous().numpy(), depth.contiguous().numpy(), limit
        )
        out = flat.copy()
        _blend(flat, where, what, out)
        ctx.saved = (flat, points, where, what, depth.shape[1:])  # type: ignore[attr-defined]
        return torch.from_numpy(out).view(image.shape)

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor | None, ...]:
        flat, points, where, what, (height, width) = ctx.saved  # type: ignore[attr-defined]
        given = gradient.contiguous().numpy().reshape(flat.shape)
        d_flat, d_clip = given.copy(), np.zeros((points.shape[0] * points.shape[1], 4))
        _backward(flat, points.reshape(-1, 4), where, what, given, height, width, d_flat, d_clip)
        as_clip = torch.from_numpy(d_clip.astype(points.dtype)).view(points.shape)
        return torch.from_numpy(d_flat).view(gradient.shape), as_clip, None, None, None, None
