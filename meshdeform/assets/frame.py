"""The axes and the unit of files of other formats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshdeform.assets.build import Up
from meshdeform.assets.placement import Floats

Unit = Literal["m", "cm", "mm"]
UNITS: dict[Unit, tuple[str, float]] = {"m": ("meter", 1.0), "cm": ("centimeter", 100.0), "mm": ("millimeter", 1e3)}
"""The name of each unit in 3MF, and how many of it are a metre."""


@dataclass(frozen=True)
class FileFrame:
    """The axes and the unit of a file; the defaults are those of glTF.

    `up`: the axis that points up. For `z`, the asset's front, +Z in glTF, becomes -Y. `metres`: how long the lengths
    that are given are, which are written in `unit`; None where nobody knows, and they are written as they are.
    """

    up: Up = "y"
    unit: Unit = "m"
    metres: float | None = 1.0

    def points(self, positions: Floats) -> Floats:
        """Return points (V, 3) of glTF's world in this frame."""
        return self.directions(positions) * (1.0 if self.metres is None else self.metres * UNITS[self.unit][1])

    def directions(self, vectors: Floats) -> Floats:
        """Return vectors (V, 3) of glTF's world in this frame, with their lengths."""
        if self.up == "y":
            return vectors
        return np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], axis=1)

    @property
    def words(self) -> str:
        """The frame in words: `mm, +Z up`."""
        return f"{'the unit of the source' if self.metres is None else self.unit}, +{self.up.upper()} up"
