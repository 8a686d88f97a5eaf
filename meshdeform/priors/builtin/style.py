"""Define the render styles and cameras of the builtin prior's training pictures."""

from __future__ import annotations

from dataclasses import replace

from meshdeform.rendering.cameras import CameraRange
from meshdeform.rendering.shading import RenderStyle

STYLE = RenderStyle(view_size=64, supersample=2, shading="normals", background=(0.0, 0.0, 0.0))
"""Style of a view in the 2 x 2 grid; four of them fill the picture."""
SINGLE_STYLE = replace(STYLE, view_size=128)
"""Style of a single view that fills the picture."""
CAMERAS = CameraRange(elevation_min_deg=0.0, elevation_max_deg=30.0, fov_min_deg=30.0, fov_max_deg=45.0)
