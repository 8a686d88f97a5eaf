"""Learn scalars on a surface: g(p) = MLP(z(p)), with features z learned at the base's vertices.

The features are interpolated along the surface, not through space: two places that are near each other but on other
sides of a wall share nothing, and the octaves of positions that an MLP on points needs are not needed.

Source: Noma et al. 2026, section 6 (eigenfunctions, heat, classes of fracture pieces by an intrinsic encoding).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from meshdeform.deformation.optimizer import Adam

__all__ = ["ScalarField", "learn_scalars"]

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_LAST_RATE = 0.01
_BATCH = 4096
_NOISE = 0.1


class ScalarField:
    """Some scalars at every place of a base.

    Parameters
    ----------
    features : (V, d) float32
        Of the base's vertices.
    layers : sequence of (weight (out, in), bias (out,)) float32
        SiLU follows every layer but the last.
    """

    def __init__(self, features: Tensor, layers: Sequence[tuple[Tensor, Tensor]]) -> None:
        self.features, self.layers = features, list(layers)

    @classmethod
    def random(
        cls, verts: _Floats, outputs: int, *, features: int = 8, width: int = 32, depth: int = 2, seed: int = 0
    ) -> ScalarField:
        """Return a field before it is learned, for a base with vertices (V, 3).

        The features begin with the positions and a little noise: what is smooth is learned sooner from smooth ones.
        """
        generator = torch.Generator().manual_seed(seed)
        first = _NOISE * torch.randn(len(verts), features, generator=generator)
        centred = torch.from_numpy((verts - verts.mean(0)) / max(float(verts.std()), 1e-12)).float()
        first[:, : min(3, features)] += centred[:, :features]
        sizes = [features, *[width] * depth, outputs]
        layers = [
            (torch.randn(after, before, generator=generator) * math.sqrt(2 / before), torch.zeros(after))
            for before, after in itertools.pairwise(sizes)
        ]
        return cls(first, layers)

    @property
    def tensors(self) -> list[Tensor]:
        """All learned tensors: the features, then weight and bias of each layer."""
        return [self.features, *[tensor for layer in self.layers for tensor in layer]]

    def __call__(self, corners: Tensor, weights: Tensor) -> Tensor:
        """Return the scalars (P, C) at places with corners (P, 3) of the base and barycentric coordinates (P, 3)."""
        x = (weights[:, :, None] * self.features[corners]).sum(1)
        for weight, bias in self.layers[:-1]:
            x = functional.silu(functional.linear(x, weight, bias))
        return functional.linear(x, *self.layers[-1])

    @torch.no_grad()
    def values(self, corners: _Index, weights: _Floats) -> _Floats:
        """Return the scalars (P, C) float64 at places, as `meshdeform.fields.patches.level_of` gives them."""
        found = self(torch.from_numpy(corners), torch.from_numpy(weights).float())
        return found.double().numpy()

    def data(self) -> bytes:
        """Return the field as a safetensors file: `features`, `layers.0.weight`, `layers.0.bias`, ...

        All are float16 but the last layer, which has the units of the values.
        """
        from safetensors.torch import save

        tensors = {"features": self.features.half()}
        for i, (weight, bias) in enumerate(self.layers):
            kind = torch.float32 if i + 1 == len(self.layers) else torch.float16
            tensors |= {f"layers.{i}.weight": weight.to(kind), f"layers.{i}.bias": bias.to(kind)}
        return save({name: tensor.detach().contiguous() for name, tensor in tensors.items()})

    @classmethod
    def read(cls, data: bytes, vertices: int) -> ScalarField:
        """Read what `data` wrote.

        Raises
        ------
        ValueError
            The file is damaged, or belongs to a base with another number of vertices.
        """
        from safetensors import SafetensorError
        from safetensors.torch import load

        try:
            tensors = {name: tensor.float() for name, tensor in load(data).items()}
        except SafetensorError as error:
            raise ValueError("The scalar field is damaged or incomplete.") from error
        features = tensors.get("features")
        if features is None or features.ndim != 2:
            raise ValueError("The file is not a scalar field.")
        if len(features) != vertices:
            raise ValueError(f"The scalar field is for a base of {len(features)} vertices, not of {vertices}.")
        layers: list[tuple[Tensor, Tensor]] = []
        width = features.shape[1]
        while (weight := tensors.get(f"layers.{len(layers)}.weight")) is not None:
            bias = tensors.get(f"layers.{len(layers)}.bias")
            if weight.ndim != 2 or weight.shape[1] != width or bias is None or bias.shape != weight.shape[:1]:
                raise ValueError(f"Layer {len(layers)} of the scalar field does not fit the one before it.")
            layers.append((weight, bias))
            width = weight.shape[0]
        if not layers:
            raise ValueError("The file is not a scalar field.")
        return cls(features, layers)


def learn_scalars(
    verts: _Floats,
    corners: _Index,
    weights: _Floats,
    values: _Floats,
    *,
    classes: bool = False,
    features: int = 8,
    width: int = 32,
    depth: int = 2,
    steps: int = 1500,
    learning_rate: float = 0.01,
    seed: int = 0,
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
        Finite; with `classes`, 1 where a place belongs to a class and 0 elsewhere.
    classes : bool
        Learn logits: a place belongs to a class where the result is above 0.
    features, width, depth, steps, learning_rate, seed
        The network and its fit.

    Returns
    -------
    ScalarField
        In the units of `values`.

    Raises
    ------
    ValueError
        A value is not finite, or numbers do not fit each other.
    """
    if values.ndim != 2 or not len(corners) == len(weights) == len(values) or not len(values):
        raise ValueError("Values must be (P, C), for as many places as there are corners and weights.")
    if not np.isfinite(values).all():
        raise ValueError("The values are not all finite.")
    middle = np.zeros(values.shape[1]) if classes else values.mean(0)
    spread = np.ones(values.shape[1]) if classes else np.maximum(values.std(0), 1e-12)
    wanted = torch.from_numpy((values - middle) / spread).float()
    places, shares = torch.from_numpy(corners), torch.from_numpy(weights).float()
    field = ScalarField.random(verts, values.shape[1], features=features, width=width, depth=depth, seed=seed)
    for tensor in field.tensors:
        tensor.requires_grad_()
    optimizer = Adam([{"params": field.tensors, "lr": 0.0}])
    generator = torch.Generator().manual_seed(seed)
    for step in range(steps):
        rows = torch.randint(0, len(values), (min(_BATCH, len(values)),), generator=generator)
        found = field(places[rows], shares[rows])
        if classes:
            loss = functional.binary_cross_entropy_with_logits(found, wanted[rows])
        else:
            loss = (found - wanted[rows]).square().mean()
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        fall = _LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + math.cos(math.pi * step / steps))
        optimizer.param_groups[0]["lr"] = learning_rate * fall
        optimizer.step()
    for tensor in field.tensors:
        tensor.requires_grad_(False)
    weight, bias = field.layers[-1]
    scale = torch.from_numpy(spread).float()
    field.layers[-1] = (weight * scale[:, None], bias * scale + torch.from_numpy(middle).float())
    return field
