"""Make the outer surface of a union of closed solids one closed surface of genus 0.

A grid has the signed distance to the union, less 0.7 of its spacing, so that what is thinner than the grid stays. Loose
pieces get bridges, cavities are filled and handles cut (`balls.py`); marching tetrahedra give the surface, and its
vertices have their nearest points on the solids.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.exemplar.balls import ball_within, connected
from meshdeform.exemplar.solid_grids import nearest_points, solid_grid
from meshdeform.geometry.isosurface import isosurface
from meshdeform.nouns.labels import Floats, Index

__all__ = ["OuterSurface", "mirror_plane", "outer_surface"]

_NODES, _ALONG = 120_000, 150
"""Of a grid, and at most along the longest side of the box."""
_LEVEL, _BAND = 0.7, 3.0
"""Distance of the surface from the solids, and that to which distances are known; in spacings."""
_CUT = 0.4
"""Value of the nodes in a cut, in spacings: the gap is about a quarter of a spacing wide."""
_SYMMETRIC = 2e-3
"""Greatest distance of a vertex's mirror image from a vertex, a share of the box's diagonal."""


@dataclass(frozen=True)
class OuterSurface:
    """A surface (V, 3), (F, 3) around solids, and the nearest points (V, 3) on these.

    With a `plane`, the half at greater x than that, a disc whose boundary lies in the plane; without, closed.
    """

    verts: Floats
    faces: Index
    positions: Floats
    plane: float | None


def mirror_plane(verts: Floats) -> float | None:
    """Return the x of the plane in which vertices (V, 3) are mirrored; None if they are not."""
    low, high = verts.min(0), verts.max(0)
    middle = float(low[0] + high[0]) / 2
    image = verts * [-1, 1, 1] + [2 * middle, 0, 0]
    apart = float(cKDTree(verts).query(image)[0].max())
    return middle if apart < _SYMMETRIC * float(np.linalg.norm(high - low)) else None


def outer_surface(verts: Floats, faces: Index) -> OuterSurface:
    """Return the outer surface of closed solids that face outward; of mirrored ones, one half."""
    plane = mirror_plane(verts)
    extent = np.ptp(verts, axis=0)
    room = float(np.maximum(extent, extent.max() / _ALONG).prod()) / (1 if plane is None else 2)
    spacing = max((room / _NODES) ** (1 / 3), float(extent.max()) / _ALONG)
    solid = solid_grid(verts, faces, spacing, _BAND, plane)
    values = np.where(solid.inside, -solid.distance, solid.distance) - _LEVEL * spacing
    whole = connected(values < 0, mirrored=plane is not None)
    ball = ball_within(whole, mirrored=plane is not None)
    values[whole & (values >= 0)] = -_CUT * spacing  # of bridges and cavities
    values[~whole & (values < 0)] = _CUT * spacing  # of crumbs
    values[whole & ~ball] = _CUT * spacing
    out, triangles = isosurface(values, solid.grid.origin, np.full(3, spacing))
    positions, distances = nearest_points(out, verts, faces, solid)
    far = np.abs(distances - _LEVEL * spacing) > 0.6 * spacing
    positions[far] = out[far]
    if plane is not None:
        positions[out[:, 0] <= plane + 1e-9 * spacing, 0] = plane
    return OuterSurface(out, triangles, positions, plane)
