"""Read the scalars that a `.ndf` holds beside its surface. numpy only; the format is in docs/surface_fit.md."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.kinds.surface_fit.patches import level_of
from meshdeform.kinds.surface_fit.reader import Layers, NeuralField, network_of, through

COLOUR = "colour"
"""Name of the scalars that are the surface's colour: sRGB in 0 to 1."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class SurfaceScalars:
    """Scalars, or pieces, at every place of a field's base: offset + scale MLP(features there)."""

    name: str
    labels: list[int]  # the numbers of the pieces, one for each output; empty for scalars
    # (C,) float64
    offset: _Floats
    scale: _Floats
    features: NDArray[np.float32]  # (V, d) float32
    layers: Layers

    def values(self, corners: _Index, weights: _Floats) -> _Floats:
        """Return the scalars (P, C) at places with corners (P, 3) of the base and weights (P, 3); of pieces, logits."""
        x = np.einsum("pk,pkd->pd", weights, self.features[corners])
        return np.asarray(self.offset + self.scale * through(self.layers, x))

    def pieces(self, corners: _Index, weights: _Floats) -> _Index:
        """Return the number of the piece (P,) that each place belongs to."""
        labels: _Index = np.array(self.labels, np.int64)[self.values(corners, weights).argmax(1)]
        return labels


def read_scalars(field: NeuralField) -> list[SurfaceScalars]:
    """Return the scalars of a field, in the order of its file.

    Raises
    ------
    ValueError
        The file contradicts itself.
    """
    try:
        return [
            _read(described, rest, len(field.verts))
            for described, rest in zip(field.header.get("scalars", []), field.more, strict=True)
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError("The .ndf contradicts itself.") from error


def colours_at(field: NeuralField, level: int) -> NDArray[np.uint8] | None:
    """Return the sRGB colours (V, 3) of the vertices of a level; None if the file has none."""
    found = [each for each in read_scalars(field) if each.name == COLOUR and len(each.offset) == 3]
    if not found:
        return None
    at = level_of(field.faces, len(field.verts), level)
    return np.asarray(np.rint(255 * found[0].values(at.corners, at.weights).clip(0, 1)), np.uint8)


def _read(described: dict[str, object], rest: NDArray[np.float32], vertices: int) -> SurfaceScalars:
    widths: list[int] = [int(width) for width in described["widths"]]  # type: ignore[attr-defined]
    features, layers = network_of(rest, vertices, widths[0], widths)
    offset, scale = (np.array(described[name], np.float64).reshape(widths[-1]) for name in ("offset", "scale"))
    labels = [int(label) for label in described.get("labels", [])]  # type: ignore[attr-defined]
    if len(labels) not in (0, widths[-1]):
        raise ValueError("sizes")
    return SurfaceScalars(str(described["name"]), labels, offset, scale, features, layers)
