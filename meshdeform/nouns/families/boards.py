"""Build what furniture and buildings are put together from: blocks that stand and straight bars."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Part, box, lathe


def block(base: ArrayLike, size: ArrayLike, soft: float = 0.05, cells: int = 2) -> Part:
    """Return a box of full side lengths `size` that stands on the middle `base` of its foot."""
    sides = np.asarray(size, float)
    return box(np.asarray(base, float) + [0, sides[1] / 2, 0], sides, round_by=soft, cells=cells)


def bar(start: ArrayLike, end: ArrayLike, thick: float, segments: int = 8) -> Part:
    """Return a straight round bar of radius `thick` between two points, beyond which its blunt ends reach."""
    foot, way = np.asarray(start, float), np.subtract(end, start)
    length, blunt = float(np.linalg.norm(way)), 0.7 * thick
    rod = lathe(
        [(blunt, -blunt), (thick, 0), (thick, length / 2), (thick, length), (blunt, length + blunt)], segments=segments
    )
    up = way / length
    side = np.cross([0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0], up)
    side /= np.linalg.norm(side)
    return Part(foot + rod.verts @ np.stack([-side, up, np.cross(up, side)]), rod.faces)
