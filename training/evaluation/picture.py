"""Render pictures of results, for people and for CLIP models: lit clay on a light background."""

from __future__ import annotations

import io

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle

SIZE = 192
"""Side of a picture in pixels."""

_AZIMUTH_DEG, _ELEVATION_DEG = 50.0, 20.0
_GROUND = (0.95, 0.95, 0.95)


@torch.no_grad()
def draw(mesh: TriangleMesh, cameras: Cameras, size: int, background: tuple[float, float, float] = _GROUND) -> Tensor:
    """Render views (B, size, size, 3) float32 in [0, 1] of a mesh, centred and scaled to fill them."""
    used = mesh.verts[mesh.faces.reshape(-1)]
    centre = (used.amin(0) + used.amax(0)) / 2
    placed = (mesh.verts - centre) / (used - centre).norm(dim=1).max().clamp_min(1e-12)
    style = RenderStyle(view_size=size, supersample=2, shading="lambert", background=background)
    return Renderer(mesh.faces, len(mesh.verts), style).render(placed, cameras).clamp(0, 1)


def picture_png(mesh: TriangleMesh) -> bytes:
    """Return a PNG of `SIZE` x `SIZE` pixels, viewed from the front, the asset's left side and above."""
    view = draw(mesh, fixed_cameras((_AZIMUTH_DEG,), _ELEVATION_DEG), SIZE)[0]
    pixels = (view * 255).round().to(torch.uint8).numpy()
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels), "RGB").save(out, "PNG", optimize=True)
    return out.getvalue()
