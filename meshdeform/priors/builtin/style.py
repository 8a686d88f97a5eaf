"""How the builtin prior sees: the render style and the cameras that its pictures were made with."""

from __future__ import annotations

from meshdeform.cameras import CameraRange
from meshdeform.shading import RenderStyle

__all__ = ["CAMERAS", "STYLE"]

STYLE = RenderStyle(view_size=64, supersample=2, shading="normals", background=(0.0, 0.0, 0.0))
CAMERAS = CameraRange(elevation_min_deg=0.0, elevation_max_deg=30.0, fov_min_deg=30.0, fov_max_deg=45.0)
