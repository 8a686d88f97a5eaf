"""Colour pixels by the normals of the faces that they show, with the gradient, in compiled loops.

Views are shared among threads. Sums are added up in float64, of each view in the order of its pixels and faces and then
of the views in their order, so the same input gives the same bits with any number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.tensors import area_vectors, through_normals
from meshdeform.support.threads import in_ranges

SLIM_SHAPE = 1e-2
"""Below this area over longest edge squared, a face passes on a smaller share of its pixels' gradients.

The gradient of a pixel grows with the reciprocal of the face's height, but is only valid for motions shorter than that
height, and no optimiser step is that short. The gradient is therefore limited to that of a face of this shape.
"""
TRUST_FROM, TRUST_OVER = 0.7, 0.25
"""Cosine between smooth and flat normal from which, and over which, the smooth one's motion counts only partly."""
_SHORTEST = 1e-12
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class _Seen(NamedTuple):
    """What the views see: the cameras (B, 3) and their axes (B, 3, 3), and the face at each pixel (B, H, W), or -1."""

    eye: _Floats
    axes: _Floats
    face_ids: _Index


class _Facets(NamedTuple):
    """A mesh, the unit normals (F, 3) of its faces, their lengths before, shares (F,), and unit normals (V, 3)."""

    verts: _Floats
    faces: _Index
    normals: _Floats
    lengths: _Floats
    share: _Floats
    smooth: _Floats


@kernel
def _scaled(vectors: _Floats) -> _Floats:
    """Return the lengths (N,) of vectors (N, 3), which become unit vectors; those of no length are divided by 1e-12."""
    lengths = np.empty(len(vectors))
    for n in range(len(vectors)):
        x, y, z = vectors[n, 0], vectors[n, 1], vectors[n, 2]
        lengths[n] = np.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / max(lengths[n], _SHORTEST)
        vectors[n, 0], vectors[n, 1], vectors[n, 2] = x * inverse, y * inverse, z * inverse
    return lengths


@kernel
def _facing(facets: _Facets, eye: _Floats, view: int, f: int) -> float:
    """Return 1 if a view sees a face from its front, else -1."""
    v, total = facets.faces[f, 0], 0.0
    for c in range(3):
        total += facets.normals[f, c] * (eye[view, c] - facets.verts[v, c])
    return -1.0 if total < 0 else 1.0


@kernel
def _draw(facets: _Facets, seen: _Seen, backdrop: _Floats, image: _Floats) -> None:
    """Fill in an image (B, H, W, 3): unit normals (F, 3), or a backdrop (B, H, W, 3) or (1, 1, 1, 3)."""
    alike, normals, axes, face_ids = backdrop.shape[1] == 1, facets.normals, seen.axes, seen.face_ids
    for view in range(face_ids.shape[0]):
        for row in range(face_ids.shape[1]):
            for column in range(face_ids.shape[2]):
                f = face_ids[view, row, column]
                if f < 0:
                    for c in range(3):
                        image[view, row, column, c] = backdrop[0, 0, 0, c] if alike else backdrop[view, row, column, c]
                    continue
                half = 0.5 * _facing(facets, seen.eye, view, f)
                for c in range(3):
                    image[view, row, column, c] = 0.5 + half * (
                        axes[view, c, 0] * normals[f, 0]
                        + axes[view, c, 1] * normals[f, 1]
                        + axes[view, c, 2] * normals[f, 2]
                    )


@kernel
def _shares(verts: _Floats, faces: _Index, lengths: _Floats) -> _Floats:
    """Return the share (F,) of its pixels' gradients that each face passes on; 0 if it has no area."""
    share = np.zeros(len(faces))
    for f in range(len(faces)):
        longest = 0.0
        for i in range(3):
            a, b, square = faces[f, i], faces[f, (i + 1) % 3], 0.0
            for c in range(3):
                square += (verts[b, c] - verts[a, c]) ** 2
            longest = max(longest, square)
        if lengths[f] > 2 * COLLAPSED_SHAPE * longest:
            share[f] = min(lengths[f] / (2 * longest) / SLIM_SHAPE, 1.0)
    return share


@kernel
def _normals(verts: _Floats, faces: _Index) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Return what `_Facets` has besides the mesh."""
    normals = area_vectors(verts, faces)
    smooth = np.zeros((len(verts), 3))
    for f in range(len(faces)):
        for i in range(3):
            for c in range(3):
                smooth[faces[f, i], c] += normals[f, c]
    _scaled(smooth)
    lengths = _scaled(normals)
    return normals, lengths, _shares(verts, faces, lengths), smooth


@kernel
def _backward(
    facets: _Facets, seen: _Seen, clip: _Floats, gradient: _Floats, d_normals: _Floats, d_clip: _Floats
) -> None:
    """Add to the gradients of each view's unit normals (B, F, 3) and of the vertices in its clip space (B, V, 4)."""
    faces, normals, share, smooth = facets.faces, facets.normals, facets.share, facets.smooth
    axes, face_ids = seen.axes, seen.face_ids
    height, width = face_ids.shape[1], face_ids.shape[2]
    x, y, g, d = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for view in range(face_ids.shape[0]):
        for row in range(height):
            for column in range(width):
                f = face_ids[view, row, column]
                if f < 0 or share[f] == 0.0:
                    continue
                # The gradient on the normal, in the world: the pixel's, turned back.
                half = 0.5 * share[f] * _facing(facets, seen.eye, view, f)
                r, s, t = gradient[view, row, column, 0], gradient[view, row, column, 1], gradient[view, row, column, 2]
                for c in range(3):
                    d[c] = half * (axes[view, 0, c] * r + axes[view, 1, c] * s + axes[view, 2, c] * t)
                    d_normals[view, f, c] += d[c]
                # Of the smooth normals only the motion counts, as `shading._motion_only` says.
                px, py = (column + 0.5) * (2.0 / width) - 1.0, 1.0 - (row + 0.5) * (2.0 / height)
                for i in range(3):
                    v = faces[f, i]
                    x[i] = clip[view, v, 0] - px * clip[view, v, 3]
                    y[i] = clip[view, v, 1] - py * clip[view, v, 3]
                a, b = x[1] * y[2] - y[1] * x[2], x[2] * y[0] - y[2] * x[0]
                total = a + b + x[0] * y[1] - y[0] * x[1]
                if total == 0.0:
                    continue
                a, b = a / total, b / total
                cosine = 0.0
                for i in range(3):
                    v, weight = faces[f, i], (a if i == 0 else b if i == 1 else 1.0 - a - b)
                    g[i] = d[0] * smooth[v, 0] + d[1] * smooth[v, 1] + d[2] * smooth[v, 2]
                    cosine += weight * (
                        normals[f, 0] * smooth[v, 0] + normals[f, 1] * smooth[v, 1] + normals[f, 2] * smooth[v, 2]
                    )
                trust = min(max((cosine - TRUST_FROM) / TRUST_OVER, 0.0), 1.0)
                if trust == 0.0:
                    continue
                mean = a * g[0] + b * g[1] + (1.0 - a - b) * g[2]
                for i in range(3):
                    j, k = (i + 1) % 3, (i + 2) % 3
                    # The area opposite to corner i is x_j y_k - y_j x_k.
                    d_area = trust * (g[i] - mean) / total
                    v, dx, dy = faces[f, j], d_area * y[k], -d_area * x[k]
                    d_clip[view, v, 0] += dx
                    d_clip[view, v, 1] += dy
                    d_clip[view, v, 3] -= px * dx + py * dy
                    v, dx, dy = faces[f, k], -d_area * y[j], d_area * x[j]
                    d_clip[view, v, 0] += dx
                    d_clip[view, v, 1] += dy
                    d_clip[view, v, 3] -= px * dx + py * dy


def colour_by_normals(
    verts: Tensor, clip: Tensor, faces: Tensor, eye: Tensor, axes: Tensor, face_ids: Tensor, backdrop: Tensor
) -> Tensor:
    """Colour every pixel by the normal of the face that it shows.

    `verts`, (V, 3) floating: positions in the world; `clip`, (B, V, 4) floating: the same positions in the views' clip
    space; `faces` is (F, 3) int64; `eye`, (B, 3) floating: positions of the cameras; `axes`, (B, 3, 3) floating:
    rotations to the cameras' frames; `face_ids`, (B, H, W) int64: the visible face at each pixel, -1 where there is
    none; `backdrop`, (B * H * W, 3) floating: colours where there is no face. Returns (B, H, W, 3) of the backdrop's
    type, differentiable once in `verts` (colours) and `clip` (their motion).
    """
    result: Tensor = _Colour.apply(verts, clip, faces, eye, axes, face_ids, backdrop)  # type: ignore[no-untyped-call]
    return result


class _Colour(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: FunctionCtx,
        verts: Tensor,
        clip: Tensor,
        faces: Tensor,
        eye: Tensor,
        axes: Tensor,
        face_ids: Tensor,
        backdrop: Tensor,
    ) -> Tensor:
        points, positions, corners, eyes, turns, ids = (
            t.detach().contiguous().numpy() for t in (verts, clip, faces, eye, axes, face_ids)
        )
        # One colour stays one: to repeat three numbers for each pixel takes longer than to draw.
        alike = backdrop.stride(0) == 0
        behind = (backdrop[:1].view(1, 1, 1, 3) if alike else backdrop.view(*face_ids.shape, 3)).contiguous().numpy()
        image = torch.empty((*face_ids.shape, 3), dtype=backdrop.dtype)
        pixels = image.numpy()
        facets = _Facets(points, corners, *_normals(points, corners))

        def draw(begin: int, end: int) -> None:
            at = slice(begin, end)
            _draw(facets, _Seen(eyes[at], turns[at], ids[at]), behind if alike else behind[at], pixels[at])

        in_ranges(draw, len(ids))
        ctx.saved = (facets, positions, eyes, turns, ids)  # type: ignore[attr-defined]
        return image

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor | None, ...]:
        facets, clip, eye, axes, face_ids = ctx.saved  # type: ignore[attr-defined]
        verts, faces, lengths = facets.verts, facets.faces, facets.lengths
        incoming = gradient.contiguous().numpy()
        d_verts, d_clip, d_normals = np.zeros(verts.shape), np.zeros(clip.shape), np.zeros((len(clip), *faces.shape))

        def through_views(begin: int, end: int) -> None:
            at = slice(begin, end)
            seen = _Seen(eye[at], axes[at], face_ids[at])
            _backward(facets, seen, clip[at], incoming[at], d_normals[at], d_clip[at])

        in_ranges(through_views, len(clip))
        inverse = np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > _SHORTEST)
        through_normals(verts, faces, facets.normals, inverse, d_normals.sum(0), d_verts)
        return (torch.from_numpy(d_verts.astype(verts.dtype)), torch.from_numpy(d_clip.astype(clip.dtype)), *[None] * 5)
