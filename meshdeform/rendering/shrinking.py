"""Average squares of pixels, with the gradient, in compiled loops."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.geometry.kernels import kernel

_Floats = NDArray[np.float64]


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
