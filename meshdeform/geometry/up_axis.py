"""Notice meshes whose up axis is plainly Z: they have a flat base at their lowest Z, and none at their lowest Y."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["looks_z_up", "up_axis_warnings"]

_DOWN = 0.97
"""Least cosine between a face of a base and the downward axis."""
_LAYER = 0.01
"""Height of the layer in which a base lies, as a share of the mesh's height."""
_BASE = 0.03
"""Least area of a base, as a share of the mesh's footprint."""
_MUCH_LESS = 0.1
"""Share of the base that the mesh may have of the other flat sides."""


def looks_z_up(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> bool:
    """Return whether a mesh stands on a flat base at its lowest Z, with no such side at its lowest Y or highest Z.

    A flat side opposite the base would also be the front and back of a flat panel that stands upright.

    Parameters
    ----------
    positions : (V, 3) float64
    triangles : (F, 3) int64
        Counter-clockwise from outside.
    """
    if not len(triangles):
        return False
    corners = positions[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    base = _flat_share(corners, cross, axis=2, sign=-1)
    others = max(_flat_share(corners, cross, axis=1, sign=-1), _flat_share(corners, cross, axis=2, sign=1))
    return base >= _BASE and others < _MUCH_LESS * base


def up_axis_warnings(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> tuple[str, ...]:
    """Return a sentence about a mesh that looks as if Z were up; nothing for others."""
    if not looks_z_up(positions, triangles):
        return ()
    return ("The asset seems to have Z up, so the model sees it on its side. Export it with +Y up.",)


def _flat_share(corners: NDArray[np.float64], cross: NDArray[np.float64], *, axis: int, sign: int) -> float:
    """Return the area of the flat side at one end of an axis, as a share of the bounding box's side there."""
    low, high = corners.min((0, 1)), corners.max((0, 1))
    extent = high - low
    side = np.prod(np.delete(extent, axis))
    if not side > 0:
        return 0.0
    end = high[axis] if sign > 0 else low[axis]
    inside = (np.abs(corners[:, :, axis] - end) <= _LAYER * extent[axis]).all(1)
    facing = sign * cross[:, axis] >= _DOWN * np.linalg.norm(cross, axis=1)
    return float(np.abs(cross[inside & facing, axis]).sum() / 2 / side)
