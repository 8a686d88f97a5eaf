"""Render the judge's views of a mesh: its own cameras, clay on white, one channel, 64 pixels per view.

These differ from the prior's views, which have face normals as colours, elevations of 0 to 30 degrees and a field of
view of 30 to 45 degrees. The judge's views are from below and above these elevations, with a narrower field of view,
smoothly shaded clay and one view per picture.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle

__all__ = ["NUM_VIEWS", "VIEW_SIZE", "draw_views", "framed", "judging_cameras", "training_cameras"]

VIEW_SIZE = 64
NUM_VIEWS = 8
_STYLE = RenderStyle(view_size=VIEW_SIZE, supersample=2, shading="lambert", background=(0.0, 0.0, 0.0))
_FOV_DEG = (20.0, 28.0)
_FROM_BELOW_DEG = (-25.0, -8.0)
_FROM_ABOVE_DEG = (36.0, 58.0)


def judging_cameras() -> tuple[Cameras, Cameras]:
    """Return the eight fixed cameras: azimuths 0, 90, ... from 15 degrees below, 45, 135, ... from 45 degrees above.

    Quarter turns of the mesh about the vertical axis only permute the views.
    """
    return fixed_cameras(0.0, -15.0, 24.0), fixed_cameras(45.0, 45.0, 24.0)


def training_cameras(rng: np.random.Generator) -> Cameras:
    """Draw four cameras a quarter turn apart at a random azimuth, two from below and two from above."""
    elevations = [float(rng.uniform(*band)) for band in (_FROM_BELOW_DEG, _FROM_ABOVE_DEG) * 2]
    order = rng.permutation(4)
    azimuth, fov = float(rng.uniform(-180.0, 180.0)), float(rng.uniform(*_FOV_DEG))
    return fixed_cameras(azimuth, tuple(elevations[k] for k in order), fov)


def framed(mesh: TriangleMesh) -> Tensor:
    """Centre the vertices (V, 3) float64 on the bounding box of the surface and scale them into the unit sphere.

    Unused vertices do not affect the box.

    Raises
    ------
    ShapeError
        There are no faces, the surface is a single point, or a position is not finite.
    """
    used = mesh.verts[mesh.faces.reshape(-1)]
    if not used.numel() or not bool(used.isfinite().all()):
        raise ShapeError("the judge needs a mesh with faces and finite positions")
    centre = (used.amin(0) + used.amax(0)) / 2
    radius = (used - centre).norm(dim=1).max()
    if not float(radius) > 0:
        raise ShapeError("the judge needs a mesh with an extent, but all vertices are one point")
    placed: Tensor = (mesh.verts - centre) / radius
    return placed


@torch.no_grad()
def draw_views(mesh: TriangleMesh, *cameras: Cameras) -> Tensor:
    """Render the framed mesh from all cameras.

    Returns
    -------
    (N, 1, 64, 64) float32 in [0, 1]: 1 is background. On the surface, 0 faces the light and 0.75 is in shade, so
    shading is never mistaken for background.
    """
    verts = framed(mesh)
    renderer = Renderer(mesh.faces, len(verts), _STYLE)
    images = torch.cat([renderer.render(verts, group)[..., :1] for group in cameras])
    return (1.0 - images.permute(0, 3, 1, 2)).clamp(0.0, 1.0)
