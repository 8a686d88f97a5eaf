"""Interpolate values of vertices at the pixels that show them.

It is perspective-correct, and differentiable in values and positions. With p the pixel in normalised coordinates and
q_i = (x_i - p_x w_i, y_i - p_y w_i), the areas a_0 = q_1 x q_2 and so on give the barycentric coordinates
b_i = a_i / (a_0 + a_1 + a_2), and the value is sum_i b_i v_i. The gradient with respect to the positions accounts for
patterns on the surface that move with it.

A face that is seen exactly edge-on can still be the nearest at a pixel, because visibility is computed on an integer
grid. Its areas then sum to zero: the three corners get equal weights, and the positions no gradient.

Source: Olano and Greer 1997, Triangle Scan Conversion using 2D Homogeneous Coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.geometry.kernels import kernel
from meshdeform.rendering import rasterizer

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class _Shown(NamedTuple):
    """Pixels (P,) of views that show the surface, as indices into (B, height, width), and the face at each."""

    pixels: _Index
    face_of_pixel: _Index
    height: int
    width: int


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
    if rasterizer.is_compiled(clip):
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
