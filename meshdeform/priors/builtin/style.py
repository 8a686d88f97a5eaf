"""How the builtin prior sees: the render styles and the cameras that its pictures were made with."""

from __future__ import annotations

from dataclasses import replace

from meshdeform.rendering.cameras import CameraRange
from meshdeform.rendering.shading import RenderStyle

__all__ = ["CAMERAS", "SINGLE_STYLE", "STYLE"]

STYLE = RenderStyle(view_size=64, supersample=2, shading="normals", background=(0.0, 0.0, 0.0))
"""A view of the 2 x 2 grid: four of them fill the picture."""
SINGLE_STYLE = replace(STYLE, view_size=128)
"""A view that fills the picture alone."""
CAMERAS = CameraRange(elevation_min_deg=0.0, elevation_max_deg=30.0, fov_min_deg=30.0, fov_max_deg=45.0)
