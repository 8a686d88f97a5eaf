"""Antialias silhouettes differentiably: walk along each silhouette edge and blend the pixel pairs that it separates.

Where a silhouette edge crosses the line between two pixel centres, the pixel that is partly covered across the edge
takes a share of the other's colour. The share depends on the position of the crossing, a smooth function of the edge's
two vertices, so the image's gradient reaches the silhouette. The walk starts from the mesh's edges rather than from
pixels whose triangles differ. It therefore also finds silhouettes of triangles that cover no pixel centre, and
gradients remain correct for triangles smaller than a pixel.

The analytic blend follows Laine et al. 2020, Modular Primitives, section 3.4; the enumeration by edges is our own.
On the CPU the walk is one compiled pass over the edges, in float64 from the given positions. Edges are visited in their
order, and sums are added up in that order, so the same input gives the same bits. Elsewhere it is plain torch.
There is no gradient where two surfaces intersect without a common edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.geometry.kernels import kernel
from meshdeform.rendering import rasterizer
from meshdeform.rendering.clay import DEPTH_BIAS
from meshdeform.rendering.visibility import EMPTY_DEPTH
from meshdeform.support.threads import in_ranges

_EMPTY = torch.iinfo(torch.int64).max
_FAR = 1048576.0
"""Clamp of pixel coordinates, far off the picture."""
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class _Blends(NamedTuple):
    """What `_walk` finds: pairs of pixels with their edges, (N, 4), and shares with their derivatives, (N, 6)."""

    where: _Index
    what: _Floats


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
    if rasterizer.is_compiled(clip):
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
