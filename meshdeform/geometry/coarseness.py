"""Detect assets whose triangles are too large to bend; without torch, because the service's asset check uses it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["coarse_share", "coarseness_warnings"]

_LONG_EDGE = 1 / 3
"""Length of an edge, as a share of the longest side of the bounding box, above which a triangle is too large. A lattice
has 24 cells on that side (`deformation.lattice.CELLS`), so such an edge is a chord across at least eight of them."""
_MOSTLY = 0.5


def coarse_share(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> float:
    """Return the share of the surface that is in triangles with an edge longer than a third of the asset.

    Parameters
    ----------
    positions : (N, 3) float64
    triangles : (T, 3) int64
    """
    corners = positions[triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    total = float(areas.sum())
    if not total > 0:
        return 0.0
    size = float(np.ptp(positions[np.unique(triangles)], axis=0).max())
    return float(areas[(edges**2).sum(2).max(1) > (_LONG_EDGE * size) ** 2].sum()) / total


def coarseness_warnings(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> tuple[str, ...]:
    """Return a sentence about an asset that is mostly too coarse to bend, with the remedy; nothing for others."""
    share = coarse_share(positions, triangles)
    if share < _MOSTLY:
        return ()
    return (
        f"{share:.0%} of the surface is in triangles with edges longer than a third of the asset. Triangles stay "
        "flat, so these surfaces cannot bend. Set output.subdivide, which splits edges longer than a tenth of the "
        "asset, or subdivide them in a modelling program.",
    )
