"""Find the places of a base whose images are nearest to points, and places along its borders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.nearest_points import SurfaceTree
from meshdeform.kinds.surface_fit.patches import Level

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


def places_of(
    faces: _Index, level: Level, images: _Floats, points: _Floats, normals: _Floats
) -> tuple[_Index, _Floats]:
    """Return corners (P, 3) in the base and barycentric coordinates (P, 3) of the places nearest to points (P, 3).

    Parameters
    ----------
    faces : (F, 3) int64
        Of the base.
    images : (V, 3) float64
        Of the level's vertices.
    normals : (P, 3) float64
        Unit normals of the surface to which the points belong; zero if unknown.
    """
    return within_base(faces, level, *SurfaceTree.of(images, level.faces).find(points, normals))


def within_base(faces: _Index, level: Level, faces_at: _Index, shares: _Floats) -> tuple[_Index, _Floats]:
    """Return corners (P, 3) in the base and weights (P, 3) of places on faces (P,) of a level with shares (P, 3)."""
    owner = faces[faces_at // (len(level.faces) // len(faces))]
    # A level's vertices have the corners of one of their faces; express them in those of the face that was found.
    rows = level.faces[faces_at]
    same = level.corners[rows][:, :, :, None] == owner[:, None, None, :]
    return owner, np.einsum("pv,pvk,pvkw->pw", shares, level.weights[rows], same.astype(np.float64))


def border_places(verts: _Floats, faces: _Index, twin: _Index, count: int) -> tuple[_Index, _Floats]:
    """Return corners (P, 3) and barycentric coordinates (P, 3) of places evenly along borders, on edges 0 to 1.

    Parameters
    ----------
    twin : (F, 3) int64
        -1 at borders; without any, there are no places.
    """
    edges = np.flatnonzero(twin.ravel() < 0)
    corners = np.stack([np.roll(faces, -k, 1).ravel()[edges] for k in range(3)], 1)
    lengths = np.linalg.norm(verts[corners[:, 1]] - verts[corners[:, 0]], axis=1)
    ends = np.cumsum(lengths)
    at = (np.arange(count if len(edges) else 0) + 0.5) / count * lengths.sum()
    chosen = np.minimum(np.searchsorted(ends, at), len(edges) - 1)
    share = (ends[chosen] - at) / lengths[chosen]
    return corners[chosen], np.stack([share, 1 - share, 0 * share], 1)
