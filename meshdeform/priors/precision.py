"""Keep half precision from overflow and underflow.

Float16 ranges from 6e-8 to 65,504. The gradient of score distillation on z0 is multiplied by the guidance's weight
before it reaches the encoder, where a small weight would underflow and a large one overflow. `scaled_backward` passes
the encoder a gradient whose largest entry is 1, and scales the resulting gradient back in float32. Since the backward
pass is linear, the result is the same wherever nothing overflows or underflows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor


class _Scale:
    """Divisor of the gradient that enters the encoder."""

    value: float = 1.0


class _Divide(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, latents: Tensor, scale: _Scale) -> Tensor:
        ctx.scale = scale
        return latents.view_as(latents)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        largest = float(gradient.abs().max())
        ctx.scale.value = largest if 0 < largest < float("inf") else 1.0
        return gradient / ctx.scale.value, None


class _Multiply(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, scale: _Scale) -> Tensor:
        ctx.scale = scale
        return image.view_as(image)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return gradient.float() * ctx.scale.value, None


def scaled_backward(encode: Callable[[Tensor], Tensor], image: Tensor) -> Tensor:
    """Encode a picture so that gradients inside the encoder are of order 1.

    `encode`: maps float32 pictures to float32 latents, computing in any precision; `image` is (B, 3, S, S) float32.
    Returns the result of `encode`, unchanged.
    """
    scale = _Scale()
    encoded: Tensor = encode(_Multiply.apply(image, scale))  # type: ignore[no-untyped-call]
    divided: Tensor = _Divide.apply(encoded, scale)  # type: ignore[no-untyped-call]
    return divided
