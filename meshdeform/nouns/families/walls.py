"""Build what buildings are put together from: roofs."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.buildings import gable
from meshdeform.nouns.families.parts import Part, extrude, lathe, moved, stretched, turned

ROOT2 = float(np.sqrt(2.0))


def roof_of(kind: str, width: float, depth: float, rise: float) -> Part:
    """Return a roof over a rectangle at the level 0.

    `kind`: "gable" (toward +Z), "ridge" (it runs along X), "hip", "slope" (one, which falls to the back) or "gambrel"
    (a gable toward +Z with two slopes on each side).
    """
    if kind == "ridge":
        return turned(gable(depth / 2, rise, width, [0, 0.05, 0]), 90, "y")
    if kind == "gable":
        return gable(width / 2, rise, depth, [0, 0.05, 0])
    if kind == "hip":
        four = turned(lathe([(1.0, -0.06), (1.0, 0.02), (0.62, 0.5 * rise), (0.26, rise)], segments=4), 45, "y")
        return stretched(four, width / ROOT2, 1, depth / ROOT2)
    if kind == "slope":
        half = depth / 2
        outline = [(-half, -0.04), (half, -0.04), (half, 0.08), (-half, rise)]
        return moved(turned(extrude(outline, width, bevel=0.03), -90, "y"), [0, 0.02, 0])
    half = width / 2
    right = [(half, -0.06), (half, 0.02), (0.68 * half, 0.62 * rise)]
    left = [(-x, y) for x, y in right[::-1]]
    return extrude([*right, (0, rise), *left], depth, bevel=0.03)
