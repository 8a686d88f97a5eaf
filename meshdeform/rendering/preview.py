"""Render `preview.png`: the asset before (upper row) and after (lower row), from four sides."""

from __future__ import annotations

import io

import numpy as np
import torch
from PIL import Image, ImageDraw
from torch import Tensor

from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle

__all__ = ["preview_png"]

_SIZE = 256
_STYLE = RenderStyle(view_size=_SIZE, supersample=2, shading="lambert", background=(0.95, 0.95, 0.95))


def preview_png(rest_verts: Tensor, verts: Tensor, faces: Tensor) -> bytes:
    """Render both states at the same scale, so that growth is visible.

    Parameters
    ----------
    rest_verts, verts : (V, 3) floating
    faces : (F, 3) int64

    Returns
    -------
    A PNG of 1024 x 512 pixels: front, left, back and right of the source above and of the result below.
    """
    both = torch.cat([rest_verts, verts]).double()
    corners = faces.reshape(-1)
    used = torch.cat([rest_verts[corners], verts[corners]]).double()
    centre = (used.amin(0) + used.amax(0)) / 2
    scale = 1 / (used - centre).norm(dim=1).max().clamp_min(1e-12)
    placed = (both - centre) * scale
    renderer = Renderer(faces, rest_verts.shape[0], _STYLE)
    cameras = fixed_cameras(25.0, 15.0)
    with torch.no_grad():
        rows = [torch.cat(list(renderer.render(v, cameras)), 1) for v in placed.chunk(2)]
    pixels = (torch.cat(rows, 0).clamp(0, 1) * 255).round().to(torch.uint8).numpy()
    image = Image.fromarray(np.ascontiguousarray(pixels), "RGB")
    draw = ImageDraw.Draw(image)
    for row, label in enumerate(("source", "result")):
        draw.text((8, row * _SIZE + 6), label, fill=(90, 90, 90))
    out = io.BytesIO()
    image.save(out, "PNG", optimize=True)
    return out.getvalue()
