"""Antialias silhouettes by walking along each silhouette edge and blending the pixel pairs that it separates.

Where a silhouette edge crosses the line between two pixel centres, the pixel that is partly covered across the edge
takes a share of the other's colour. The share depends on the position of the crossing, a smooth function of the edge's
two vertices, so the image's gradient reaches the silhouette. The walk starts from the mesh's edges rather than from
pixels whose triangles differ. It therefore also finds silhouettes of triangles that cover no pixel centre, and
gradients remain correct for triangles smaller than a pixel.

The analytic blend follows Laine et al. 2020, Modular Primitives, section 3.4; the enumeration by edges is our own.
There is no gradient where two surfaces intersect without a common edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from meshdeform.rendering.rasterizer import backend
from meshdeform.rendering.rasterizer.compiled_edges import antialias_compiled
from meshdeform.rendering.rasterizer.spans import EMPTY_DEPTH

__all__ = ["SilhouetteEdges", "antialias"]

_EMPTY = torch.iinfo(torch.int64).max
_DEPTH_BIAS = 1e-4


@dataclass(frozen=True)
class SilhouetteEdges:
    """Edges of the mesh with the opposite vertices of their faces.

    Attributes
    ----------
    verts : (E, 2) int64
        End points.
    opposite : (E, 2) int64
        Third vertex of the edge's first and second face; -1 if there is no second one (open borders).
    """

    verts: Tensor
    opposite: Tensor


def antialias(
    image: Tensor, clip: Tensor, edges: SilhouetteEdges, depth: Tensor, removed: Tensor | None = None
) -> Tensor:
    """Blend pixel pairs across silhouettes, differentiably in `clip` and `image`.

    Parameters
    ----------
    image : (B, H, W, C) floating
    clip : (B, V, 4) floating
        The rasterised vertices.
    edges : SilhouetteEdges
    depth : (B, H, W) float32
        From `rasterize`: of the surface that is seen.
    removed : (B, H, W) float32, optional
        Depth of the farthest surface in front of it that is cut out there, -inf where there is none: the edges of
        that surface separate nothing.

    Returns
    -------
    (B, H, W, C), the antialiased image.
    """
    if backend.is_compiled(clip):
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
    seen = on_screen & (depth.reshape(-1)[outside] > z_edge + _DEPTH_BIAS)
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
