"""Round learned tensors to whole multiples of a step, in the file and in the last part of a fit.

A weight of its own distribution needs about log2(4 spread / step) bits, so the steps are shares of the spread: one for
each channel of the features, whose spreads differ, and one for each weight and bias of the layers. A fit that goes on
with rounded tensors makes up for the rounding. Gradients pass through it as if it were not there.

Source: Bengio, Léonard and Courville 2013 (the straight-through estimator); Jacob et al. 2018, Quantization and
Training of Neural Networks (fits with rounded weights).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

START = 0.85
"""Share of a fit's iterations before its tensors are rounded."""
IN_SPREAD, _OF_ITERATIONS, _FINER = 8.0, 400, 2.0
"""Steps in the root mean square of a tensor, after so many iterations of a fit; how many times as many at most."""
_LEAST = 1e-6
_MOST = 32_767
"""Greatest whole number that a section of a `.ndf` holds."""


def steps_of(tensors: Sequence[Tensor], iterations: int = _OF_ITERATIONS, in_spread: float = IN_SPREAD) -> list[int]:
    """Return the steps for features (V, d) and other tensors, as exponents n of 2^(n / 4): d and one each.

    A longer fit is more precise, so its steps are finer: with the square root of its iterations.
    """
    in_spread *= min(math.sqrt(max(iterations / _OF_ITERATIONS, 1.0)), _FINER)
    features, *others = [tensor.detach().double() for tensor in tensors]
    spreads = [*features.square().mean(0).sqrt().tolist(), *[float(each.square().mean().sqrt()) for each in others]]
    largest = [*features.abs().amax(0).tolist(), *[float(each.abs().max()) for each in others]]
    wanted = [max(s / in_spread, m / _MOST, _LEAST) for s, m in zip(spreads, largest, strict=True)]
    return [math.ceil(4 * math.log2(step)) for step in wanted]


def rounded(tensors: Sequence[Tensor], steps: Sequence[int]) -> list[Tensor]:
    """Return the nearest multiples of the steps; their gradients are those of the tensors."""
    found = []
    for tensor, step in zip(tensors, _sizes(tensors, steps), strict=True):
        near = (tensor.detach() / step).round() * step
        found.append(tensor + (near - tensor.detach()))
    return found


def whole(tensors: Sequence[Tensor], steps: Sequence[int]) -> list[Tensor]:
    """Return the tensors in steps: whole numbers, int64."""
    with torch.no_grad():
        sizes = _sizes(tensors, steps)
        return [(tensor.double() / step.double()).round().long() for tensor, step in zip(tensors, sizes, strict=True)]


def _sizes(tensors: Sequence[Tensor], steps: Sequence[int]) -> list[Tensor]:
    """Return the step of each channel (d,) of the features, and those of the other tensors (), as they are."""
    size = torch.pow(2.0, torch.tensor(list(steps), dtype=torch.float64) / 4).float()
    channels = tensors[0].shape[1]
    if len(size) != channels + len(tensors) - 1:
        raise ValueError(f"{len(size)} steps for {channels} channels and {len(tensors) - 1} other tensors.")
    return [size[:channels], *size[channels:]]
