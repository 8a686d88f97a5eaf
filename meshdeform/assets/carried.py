"""Carry points and lines along with the surface: they have no faces to deform, but belong to the object.

Each vertex moves like the nearest vertices of triangles (`meshdeform.geometry.scattered`); one at the place of such a
vertex follows it exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.surface import Block, Floats, Surface

__all__ = ["carried_positions"]


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
    from meshdeform.geometry.scattered import interpolate

    used = np.unique(surface.triangles)
    world = [block.positions @ block.placement[:3, :3].T + block.placement[:3, 3] for block in blocks]
    shift = interpolate(surface.positions[used], moved[used], np.concatenate(world))  # one search tree for all
    ends = np.cumsum([len(positions) for positions in world])[:-1]
    return [
        (block.positions + part @ np.linalg.inv(block.placement[:3, :3]).T).astype(np.float32)
        for block, part in zip(blocks, np.split(shift, ends), strict=True)
    ]
