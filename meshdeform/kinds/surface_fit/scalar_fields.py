"""Learn scalars on a surface: g(p) = MLP(z(p)), with features z learned at the base's vertices.

The features are interpolated along the surface, not through space: two places that are near each other but on other
sides of a wall share nothing, and the octaves of positions that an MLP on points needs are not needed.

Source: Noma et al. 2026, section 6 (eigenfunctions, heat, classes of fracture pieces by an intrinsic encoding).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from meshdeform.deformation.variables import Adam
from meshdeform.kinds.surface_fit.network import START, FieldNetwork, rounded, steps_of

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
STEPS = 600
_FEATURES, _HIDDEN = 8, (32, 32)
_RATE, _LAST_RATE = 0.01, 0.01
_BATCH = 4096
_NOISE = 0.1
_PIECES_IN_SPREAD, _VALUES_IN_SPREAD = 8.0, 32.0
"""Steps in the root mean square of a tensor: with eight, the errors of values double."""


class ScalarField(FieldNetwork):
    """Some scalars at every place of a base: offset + scale MLP(features there).

    Parameters
    ----------
    tensors : sequence of float32
        As `FieldNetwork.tensors`.
    offset, scale : (C,) float64
    labels : sequence of int, optional
        For pieces, the number of each: its output is a logit.
    rounding : list of int, optional
        The steps of which all tensors are multiples (`network.rounded`).
    """

    def __init__(
        self,
        name: str,
        tensors: Sequence[Tensor],
        offset: _Floats,
        scale: _Floats,
        labels: Sequence[int] = (),
        rounding: list[int] | None = None,
    ) -> None:
        super().__init__(tensors[0], list(zip(tensors[1::2], tensors[2::2], strict=True)), 0)
        self.name, self.offset, self.scale, self.labels, self.rounding = name, offset, scale, list(labels), rounding

    def rounded(self, rounding: list[int]) -> ScalarField:
        """Return the same scalars with rounded tensors."""
        tensors = rounded(self.tensors, rounding)
        return ScalarField(self.name, tensors, self.offset, self.scale, self.labels, rounding)

    def at(self, corners: Tensor, weights: Tensor) -> Tensor:
        """Return (scalars - offset) / scale (P, C) at places of the base: corners (P, 3), weights (P, 3)."""
        return self.through((weights[:, :, None] * self.features[corners]).sum(1))

    @torch.no_grad()
    def values(self, corners: _Index, weights: _Floats) -> _Floats:
        """Return the scalars (P, C) float64 at places, as `patches.level_of` gives them."""
        predicted = self.at(torch.from_numpy(corners), torch.from_numpy(weights).float())
        return np.asarray(self.offset + self.scale * predicted.double().numpy())

    @property
    def header(self) -> dict[str, Any]:
        """Return its part of the header of a `.ndf`; its section has the tensors."""
        return {
            "name": self.name,
            "widths": [self.features.shape[1], *[len(bias) for _, bias in self.layers]],
            "offset": self.offset.tolist(),
            "scale": self.scale.tolist(),
            **({"labels": self.labels} if self.labels else {}),
        }


def _random(verts: _Floats, outputs: int, seed: int) -> list[Tensor]:
    """Return the features and the weights and biases of each layer before they are learned."""
    # The features begin with the positions and a little noise: what is smooth is learned sooner from smooth ones.
    generator = torch.Generator().manual_seed(seed)
    first = _NOISE * torch.randn(len(verts), _FEATURES, generator=generator)
    centred = torch.from_numpy((verts - verts.mean(0)) / max(float(verts.std()), 1e-12)).float()
    first[:, :3] += centred
    tensors = [first]
    for before, after in itertools.pairwise([_FEATURES, *_HIDDEN, outputs]):
        tensors += [torch.randn(after, before, generator=generator) * math.sqrt(2 / before), torch.zeros(after)]
    return tensors


def learn_scalars(
    verts: _Floats,
    corners: _Index,
    weights: _Floats,
    values: _Floats,
    *,
    name: str = "scalars",
    labels: Sequence[int] = (),
    steps: int = STEPS,
    seed: int = 0,
    on_step: Callable[[], None] = lambda: None,
) -> ScalarField:
    """Learn scalars from their values at places of a base.

    Parameters
    ----------
    verts : (V, 3) float64
        Of the base.
    corners : (P, 3) int64
    weights : (P, 3) float64
        Barycentric coordinates.
    values : (P, C) float64
        Finite; with `labels`, 1 where a place belongs to a piece and 0 elsewhere.
    labels : sequence of int, optional
        The number of each piece. A binary classifier of each is learned; a place belongs to the one with the greatest
        result.
    steps, seed
        Of the fit.
    on_step : callable
        Called after each step.

    Returns
    -------
    ScalarField
        In the units of `values`.
    """
    offset = np.zeros(values.shape[1]) if labels else values.mean(0)
    scale = np.ones(values.shape[1]) if labels else np.maximum(values.std(0), 1e-12)
    target = torch.from_numpy((values - offset) / scale).float()
    places, shares = torch.from_numpy(corners), torch.from_numpy(weights).float()
    tensors = _random(verts, values.shape[1], seed)
    field = ScalarField(name, tensors, offset, scale, labels)
    for tensor in tensors:
        tensor.requires_grad_()
    optimizer = Adam([{"params": tensors, "lr": 0.0}])
    generator = torch.Generator().manual_seed(seed)
    rounding: list[int] | None = None
    in_spread = _PIECES_IN_SPREAD if labels else _VALUES_IN_SPREAD
    for step in range(steps):
        if rounding is None and step >= START * steps:
            rounding = steps_of(tensors, in_spread=in_spread)
        rows = torch.randint(0, len(values), (min(_BATCH, len(values)),), generator=generator)
        used = field if rounding is None else field.rounded(rounding)
        prediction = used.at(places[rows], shares[rows])
        if labels:
            loss = functional.binary_cross_entropy_with_logits(prediction, target[rows])
        else:
            loss = (prediction - target[rows]).square().mean()
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        fall = _LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + math.cos(math.pi * step / steps))
        optimizer.param_groups[0]["lr"] = _RATE * fall
        optimizer.step()
        on_step()
    for tensor in tensors:
        tensor.requires_grad_(False)
    return field.rounded(rounding or steps_of(tensors, in_spread=in_spread))
