"""Define the field: f(p) = p + MLP([features at p, p, octaves of p]) for a point p of the base mesh.

The features are learned at the base's vertices and interpolated linearly in its faces; the octaves are
sin(2^k pi p) and cos(2^k pi p), k = 0, 1, ... All coordinates are those of the
frame, in which the base lies in [-1, 1].

Source: Noma et al. 2026, section 4; Mildenhall et al. 2020, NeRF, equation 4 (the octaves).
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
        x = torch.cat([features, encoded], -1)
        for weight, bias in self.layers[:-1]:
            x = functional.silu(functional.linear(x, weight, bias))
        return functional.linear(x, *self.layers[-1])

    def __call__(self, points: Tensor, features: Tensor) -> Tensor:
        """Return f (P, 3) at points (P, 3) of the base with interpolated features (P, d)."""
        return points + self.displacement(features, octaves_of(points, self.octaves))
