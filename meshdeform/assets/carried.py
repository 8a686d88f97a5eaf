"""Carry points and lines along with the surface: they have no faces to deform, but belong to the object.

Each vertex moves like the surface around it: by the mean displacement of the nearest vertices of triangles, weighted by
the inverse squared distance (Shepard 1968, A Two-Dimensional Interpolation Function for Irregularly-Spaced Data). One
at the place of a vertex of the surface follows it exactly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.surface import Block, Floats, Surface

__all__ = ["carried_positions"]

_NEIGHBOURS = 4


def carried_positions(surface: Surface, moved: Floats, blocks: list[Block]) -> list[NDArray[np.float32]]:
    """Return the new positions of points and lines, in the space of their meshes.

    Parameters
    ----------
    surface : Surface
    moved : (N, 3) float64
        Displacement of its vertices, in world space.
    blocks : list of Block
        The points and lines.

    Returns
    -------
    A (V, 3) float32 array for each block.
    """
    if not blocks:
        return []
    from scipy.spatial import cKDTree

    used = np.unique(surface.triangles)
    tree: Any = cKDTree(surface.positions[used])
    count = min(_NEIGHBOURS, len(used))
    found = []
    for block in blocks:
        linear = block.placement[:3, :3]
        distance, near = tree.query(block.positions @ linear.T + block.placement[:3, 3], k=[*range(1, count + 1)])
        nearest = np.maximum(distance[:, :1], 1e-300)
        weight = np.where(distance[:, :1] == 0.0, distance == 0.0, (nearest / np.maximum(distance, nearest)) ** 2)
        weight = weight / weight.sum(axis=1, keepdims=True)
        shift = (weight[:, :, None] * moved[used[near]]).sum(axis=1)
        found.append((block.positions + shift @ np.linalg.inv(linear).T).astype(np.float32))
    return found
