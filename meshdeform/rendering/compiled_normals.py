"""Colour pixels by the normals of their faces on the CPU: `normals` of `shading`, compiled, with its gradient.

Views are shared among threads. Sums are added up in float64, of each view in the order of its pixels and faces
and then of the views in their order, so the same input gives the same bits with any number of threads.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.geometry.area_vectors import area_vectors
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.rest_mesh import COLLAPSED_SHAPE
from meshdeform.support.threads import in_ranges

__all__ = ["SLIM_SHAPE", "TRUST_FROM", "TRUST_OVER", "colour_by_normals", "shrink"]

SLIM_SHAPE = 1e-2
"""Below this area over longest edge squared, a face passes on a smaller share of its pixels' gradients.

The gradient of a pixel grows with the reciprocal of the face's height, but is only valid for motions shorter than that
height, and no optimiser step is that short. The gradient is therefore limited to that of a face of this shape.
"""
TRUST_FROM, TRUST_OVER = 0.7, 0.25
"""Cosine between smooth and flat normal from which, and over which, the smooth one's motion counts in part."""

_SHORTEST = 1e-12

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


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
def _facing(normals: _Floats, verts: _Floats, faces: _Index, eye: _Floats, view: int, f: int) -> float:
    """Return 1 if a view sees a face from its front, else -1."""
    v, total = faces[f, 0], 0.0
    for c in range(3):
        total += normals[f, c] * (eye[view, c] - verts[v, c])
    return -1.0 if total < 0 else 1.0


@kernel
def _draw(
    verts: _Floats,
    normals: _Floats,
    faces: _Index,
    eye: _Floats,
    axes: _Floats,
    face_ids: _Index,
    backdrop: _Floats,
    image: _Floats,
) -> None:
    """Fill in an image (B, H, W, 3): unit normals (F, 3), or a backdrop (B, H, W, 3) or (1, 1, 1, 3)."""
    alike = backdrop.shape[1] == 1
    for view in range(face_ids.shape[0]):
        for row in range(face_ids.shape[1]):
            for column in range(face_ids.shape[2]):
                f = face_ids[view, row, column]
                if f < 0:
                    for c in range(3):
                        image[view, row, column, c] = backdrop[0, 0, 0, c] if alike else backdrop[view, row, column, c]
                    continue
                half = 0.5 * _facing(normals, verts, faces, eye, view, f)
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
    """Return unit normals (F, 3) of the faces, their lengths before and shares (F,), and unit normals (V, 3)."""
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
    verts: _Floats,
    clip: _Floats,
    faces: _Index,
    eye: _Floats,
    axes: _Floats,
    face_ids: _Index,
    normals: _Floats,
    share: _Floats,
    smooth: _Floats,
    gradient: _Floats,
    d_normals: _Floats,
    d_clip: _Floats,
) -> None:
    """Add to the gradients of each view's unit normals (B, F, 3) and of the vertices' places in it (B, V, 4)."""
    height, width = face_ids.shape[1], face_ids.shape[2]
    x, y, g, d = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for view in range(face_ids.shape[0]):
        for row in range(height):
            for column in range(width):
                f = face_ids[view, row, column]
                if f < 0 or share[f] == 0.0:
                    continue
                # The gradient on the normal, in the world: the pixel's, turned back.
                half = 0.5 * share[f] * _facing(normals, verts, faces, eye, view, f)
                r, s, t = gradient[view, row, column, 0], gradient[view, row, column, 1], gradient[view, row, column, 2]
                for c in range(3):
                    d[c] = half * (axes[view, 0, c] * r + axes[view, 1, c] * s + axes[view, 2, c] * t)
                    d_normals[view, f, c] += d[c]
                # Of the smooth normals only the motion counts, as `_motion_only` says.
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
                    # The area of part i is x_j y_k - y_j x_k.
                    d_area = trust * (g[i] - mean) / total
                    v, dx, dy = faces[f, j], d_area * y[k], -d_area * x[k]
                    d_clip[view, v, 0] += dx
                    d_clip[view, v, 1] += dy
                    d_clip[view, v, 3] -= px * dx + py * dy
                    v, dx, dy = faces[f, k], -d_area * y[j], d_area * x[j]
                    d_clip[view, v, 0] += dx
                    d_clip[view, v, 1] += dy
                    d_clip[view, v, 3] -= px * dx + py * dy


@kernel
def _through_normals(
    verts: _Floats, faces: _Index, normals: _Floats, lengths: _Floats, d_normals: _Floats, d_verts: _Floats
) -> None:
    """Take the gradient of unit normals (F, 3), faces times their lengths, to the vertices (V, 3)."""
    for f in range(len(faces)):
        if lengths[f] <= _SHORTEST:
            continue
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        along = 0.0
        for c in range(3):
            along += normals[f, c] * d_normals[f, c]
        inverse = 1.0 / lengths[f]
        gx = (d_normals[f, 0] - along * normals[f, 0]) * inverse
        gy = (d_normals[f, 1] - along * normals[f, 1]) * inverse
        gz = (d_normals[f, 2] - along * normals[f, 2]) * inverse
        bx, by, bz = verts[j, 0] - verts[i, 0], verts[j, 1] - verts[i, 1], verts[j, 2] - verts[i, 2]
        cx, cy, cz = verts[k, 0] - verts[i, 0], verts[k, 1] - verts[i, 1], verts[k, 2] - verts[i, 2]
        jx, jy, jz = cy * gz - cz * gy, cz * gx - cx * gz, cx * gy - cy * gx
        kx, ky, kz = gy * bz - gz * by, gz * bx - gx * bz, gx * by - gy * bx
        d_verts[j, 0] += jx
        d_verts[j, 1] += jy
        d_verts[j, 2] += jz
        d_verts[k, 0] += kx
        d_verts[k, 1] += ky
        d_verts[k, 2] += kz
        d_verts[i, 0] -= jx + kx
        d_verts[i, 1] -= jy + ky
        d_verts[i, 2] -= jz + kz


@kernel
def _shrink(image: _Floats, factor: int, out: _Floats) -> None:
    """Fill in the means (H, W, C) of squares of an image (factor H, factor W C)."""
    height, width, channels = out.shape
    share = out.dtype.type(1.0 / (factor * factor))
    sums = np.empty(image.shape[1], out.dtype)
    for row in range(height):
        sums[:] = image[row * factor]
        for i in range(1, factor):
            sums += image[row * factor + i]
        for column in range(width):
            begin = column * factor * channels
            for c in range(channels):
                total = sums[begin + c]
                for j in range(1, factor):
                    total += sums[begin + j * channels + c]
                out[row, column, c] = total * share


@kernel
def _spread(gradient: _Floats, factor: int, out: _Floats) -> None:
    """Fill in the gradient (factor H, factor W C) of `_shrink`."""
    height, width, channels = gradient.shape
    share = out.dtype.type(1.0 / (factor * factor))
    for row in range(height):
        first = out[row * factor]
        for column in range(width):
            begin = column * factor * channels
            for j in range(factor):
                for c in range(channels):
                    first[begin + j * channels + c] = gradient[row, column, c] * share
        for i in range(1, factor):
            out[row * factor + i] = first


class _Shrink(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, image: Tensor, factor: int) -> Tensor:
        views, height, width, channels = image.shape
        ctx.factor = factor  # type: ignore[attr-defined]
        out = torch.empty((views, height // factor, width // factor, channels), dtype=image.dtype)
        rows = image.detach().contiguous().view(views * height, width * channels)
        _shrink(rows.numpy(), factor, out.flatten(0, 1).numpy())
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor, None]:
        factor: int = ctx.factor  # type: ignore[attr-defined]
        views, height, width, channels = gradient.shape
        out = torch.empty((views, height * factor, width * factor, channels), dtype=gradient.dtype)
        rows = out.view(views * height * factor, width * factor * channels)
        _spread(gradient.contiguous().flatten(0, 1).numpy(), factor, rows.numpy())
        return out, None


def shrink(image: Tensor, factor: int) -> Tensor:
    """Return the means (B, H, W, C) of squares of pixels of an image (B, factor H, factor W, C) on the CPU."""
    result: Tensor = _Shrink.apply(image, factor)  # type: ignore[no-untyped-call]
    return result


def colour_by_normals(
    verts: Tensor, clip: Tensor, faces: Tensor, eye: Tensor, axes: Tensor, face_ids: Tensor, backdrop: Tensor
) -> Tensor:
    """Colour every pixel by the normal of the face that it shows.

    Parameters
    ----------
    verts : (V, 3) floating
        Positions in the world.
    clip : (B, V, 4) floating
        The same positions in the views' clip space.
    faces : (F, 3) int64
    eye : (B, 3) floating
        Positions of the cameras.
    axes : (B, 3, 3) floating
        Rotations to the cameras' frames.
    face_ids : (B, H, W) int64
        The visible face at each pixel, -1 where there is none.
    backdrop : (B * H * W, 3) floating
        Colours where there is no face.

    Returns
    -------
    (B, H, W, 3) of the backdrop's type, differentiable once in `verts` (colours) and `clip` (their motion).
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
        points, places, corners, eyes, turns, ids = (
            t.detach().contiguous().numpy() for t in (verts, clip, faces, eye, axes, face_ids)
        )
        # One colour stays one: to repeat three numbers for each pixel takes longer than to draw.
        alike = backdrop.stride(0) == 0
        behind = (backdrop[:1].view(1, 1, 1, 3) if alike else backdrop.view(*face_ids.shape, 3)).contiguous().numpy()
        image = torch.empty((*face_ids.shape, 3), dtype=backdrop.dtype)
        pixels = image.numpy()
        kept = _normals(points, corners)

        def draw(begin: int, end: int) -> None:
            at = slice(begin, end)
            seen = behind if alike else behind[at]
            _draw(points, kept[0], corners, eyes[at], turns[at], ids[at], seen, pixels[at])

        in_ranges(draw, len(ids))
        ctx.saved = (points, places, corners, eyes, turns, ids, kept)  # type: ignore[attr-defined]
        return image

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor | None, ...]:
        verts, clip, faces, eye, axes, face_ids, kept = ctx.saved  # type: ignore[attr-defined]
        normals, lengths, share, smooth = kept
        given = gradient.contiguous().numpy()
        d_verts, d_clip, d_normals = np.zeros(verts.shape), np.zeros(clip.shape), np.zeros((len(clip), *faces.shape))

        def through_views(begin: int, end: int) -> None:
            at = slice(begin, end)
            _backward(
                verts, clip[at], faces, eye[at], axes[at], face_ids[at], normals, share, smooth, given[at],
                d_normals[at], d_clip[at],
            )  # fmt: skip

        in_ranges(through_views, len(clip))
        _through_normals(verts, faces, normals, lengths, d_normals.sum(0), d_verts)
        return (
            torch.from_numpy(d_verts.astype(verts.dtype)),
            torch.from_numpy(d_clip.astype(clip.dtype)),
            *[None] * 5,
        )
