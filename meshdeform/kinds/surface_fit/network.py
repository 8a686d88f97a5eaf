"""Define the field: f(p) = p + MLP([features at p, p, octaves of p]) for a point p of the base mesh.

The features are learned at the base's vertices and interpolated linearly in its faces; the octaves are sin(2^k pi p)
and cos(2^k pi p), k = 0, 1, ... All coordinates are those of the frame, in which the base lies in [-1, 1].

Source: Noma et al. 2026, section 4; Mildenhall et al. 2020, NeRF, equation 4 (the octaves).

Round learned tensors to whole multiples of a step, in the file and in the last part of a fit.

A weight of its own distribution needs about log2(4 spread / step) bits, so the steps are shares of the spread: one for
each channel of the features, whose spreads differ, and one for each weight and bias of the layers. A fit that goes on
with rounded tensors makes up for the rounding. Gradients pass through it as if it were not there.

Source: Bengio, Léonard and Courville 2013 (the straight-through estimator); Jacob et al. 2018, Quantization and
Training of Neural Networks (fits with rounded weights).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

_FIRST_FEATURES = 0.1
_LAST_LAYER = 1e-2
START = 0.85
"""Share of a fit's iterations before its tensors are rounded."""
IN_SPREAD = 16.0
"""Steps in the root mean square of a tensor."""
_LEAST = 1e-6
_MOST = 32_767
"""Greatest whole number that a section of a `.ndf` holds."""


def octaves_of(points: Tensor, octaves: int) -> Tensor:
    """Return p, sin(2^k pi p) and cos(2^k pi p), k < octaves: (..., 3) to (..., 3 + 6 octaves)."""
    waves = [points * (2.0**k * math.pi) for k in range(octaves)]
    return torch.cat([points, *[part for wave in waves for part in (wave.sin(), wave.cos())]], -1)


class FieldNetwork:
    """The learned part of a field.

    Parameters
    ----------
    features : (V, d) float32
        Of the base's vertices.
    layers : sequence of (weight (out, in), bias (out,)) float32
        SiLU follows every layer but the last.
    """

    def __init__(self, features: Tensor, layers: Sequence[tuple[Tensor, Tensor]], octaves: int) -> None:
        self.features, self.layers, self.octaves = features, list(layers), octaves

    @classmethod
    def random(cls, vertices: int, features: int, octaves: int, width: int, depth: int, seed: int) -> FieldNetwork:
        """Return a field that displaces little, from `seed`."""
        generator = torch.Generator().manual_seed(seed)
        sizes = [features + 3 + 6 * octaves, *[width] * depth, 3]
        layers = []
        for i, (before, after) in enumerate(itertools.pairwise(sizes)):
            weight = torch.randn(after, before, generator=generator) * math.sqrt(2 / before)
            layers.append((weight * _LAST_LAYER if i == depth else weight, torch.zeros(after)))
        return cls(_FIRST_FEATURES * torch.randn(vertices, features, generator=generator), layers, octaves)

    @property
    def tensors(self) -> list[Tensor]:
        """All learned tensors, in the order of the file: the features, then weight and bias of each layer."""
        return [self.features, *[tensor for layer in self.layers for tensor in layer]]

    def with_tensors(self, tensors: Sequence[Tensor]) -> FieldNetwork:
        """Return the same network with other tensors, in the order of `tensors`."""
        features, *rest = tensors
        return FieldNetwork(features, list(zip(rest[::2], rest[1::2], strict=True)), self.octaves)

    def displacement(self, features: Tensor, encoded: Tensor) -> Tensor:
        """Return the displacements (P, 3) from interpolated features (P, d) and octaves (P, 3 + 6 octaves)."""
        return self.through(torch.cat([features, encoded], -1))

    def through(self, x: Tensor) -> Tensor:
        """Return what the layers make of inputs (P, K)."""
        for weight, bias in self.layers[:-1]:
            x = functional.silu(functional.linear(x, weight, bias))
        return functional.linear(x, *self.layers[-1])

    def __call__(self, points: Tensor, features: Tensor) -> Tensor:
        """Return f (P, 3) at points (P, 3) of the base with interpolated features (P, d)."""
        return points + self.displacement(features, octaves_of(points, self.octaves))


def steps_of(tensors: Sequence[Tensor], in_spread: float = IN_SPREAD) -> list[int]:
    """Return the steps for features (V, d) and other tensors, as exponents n of 2^(n / 4): d and one each."""
    features, *others = [tensor.detach().double() for tensor in tensors]
    spreads = [*features.square().mean(0).sqrt().tolist(), *[float(each.square().mean().sqrt()) for each in others]]
    largest = [*features.abs().amax(0).tolist(), *[float(each.abs().max()) for each in others]]
    steps = [max(s / in_spread, m / _MOST, _LEAST) for s, m in zip(spreads, largest, strict=True)]
    return [math.ceil(4 * math.log2(step)) for step in steps]


def rounded(tensors: Sequence[Tensor], steps: Sequence[int]) -> list[Tensor]:
    """Return the nearest multiples of the steps; their gradients are those of the tensors."""
    results = []
    for tensor, step in zip(tensors, _sizes(tensors, steps), strict=True):
        near = (tensor.detach() / step).round() * step
        results.append(tensor + (near - tensor.detach()))
    return results


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
