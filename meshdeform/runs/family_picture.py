"""Draw a collection, coloured by part."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from meshdeform.assets import Asset, Limits, Primitive, build_glb, load_asset
from meshdeform.rendering.studio import Pose, Studio

__all__ = ["COLOURS", "assets_png", "family_png"]

COLOURS = (
    (0.00, 0.17, 0.45, 1.0),
    (0.73, 0.27, 0.00, 1.0),
    (0.00, 0.34, 0.17, 1.0),
    (0.60, 0.05, 0.25, 1.0),
    (0.85, 0.60, 0.02, 1.0),
    (0.10, 0.45, 0.75, 1.0),
    (0.30, 0.15, 0.50, 1.0),
    (0.25, 0.25, 0.25, 1.0),
)
"""Linear RGBA by part; after the last, the first again."""

_SIZE, _AZIMUTH_DEG, _MARGIN = 160, 35.0, 28

Shown = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]


def family_png(shapes: Sequence[Shown], parts: Sequence[str]) -> bytes:
    """Draw shapes in rows, with the names of the parts in their colours below.

    Parameters
    ----------
    shapes : sequence of (positions (N, 3), triangles (F, 3), part of each triangle (F,))
    parts : sequence of str
    """
    columns = min(max(math.ceil(math.sqrt(len(shapes) * 1.5)), 3), len(shapes))
    rows = -(-len(shapes) // columns)
    sheet = Image.new("RGB", (columns * _SIZE, rows * _SIZE + _MARGIN), (255, 255, 255))
    for number, shape in enumerate(shapes):
        sheet.paste(_drawn(shape), (number % columns * _SIZE, number // columns * _SIZE))
    draw, font, x = ImageDraw.Draw(sheet), ImageFont.load_default(14), 10
    for number, part in enumerate(parts):
        colour = tuple(round(255 * value ** (1 / 2.2)) for value in COLOURS[number % len(COLOURS)][:3])
        draw.rectangle((x, sheet.height - 20, x + 12, sheet.height - 8), fill=colour)
        draw.text((x + 18, sheet.height - 22), part, fill=(40, 42, 48), font=font)
        x += 36 + round(draw.textlength(part, font=font))
    out = io.BytesIO()
    sheet.save(out, "PNG")
    return out.getvalue()


def _drawn(shape: Shown) -> Image.Image:
    positions, triangles, found = shape
    coloured = []
    for part in np.unique(found):
        rows, faces = np.unique(triangles[found == part], return_inverse=True)
        colour = COLOURS[part % len(COLOURS)]
        coloured.append(Primitive(positions[rows], faces.reshape(-1, 3), material=f"part {part}", base_color=colour))
    asset = load_asset(build_glb(coloured), "shape.glb", Limits.unlimited())
    return _photograph(asset)


def assets_png(assets: Sequence[Asset], titles: Sequence[str]) -> bytes:
    """Draw assets in rows as their materials show them, each above its title."""
    columns = min(max(math.ceil(math.sqrt(len(assets) * 1.5)), 3), len(assets))
    rows = -(-len(assets) // columns)
    height = _SIZE + _MARGIN
    sheet = Image.new("RGB", (columns * _SIZE, rows * height), (255, 255, 255))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for number, (asset, title) in enumerate(zip(assets, titles, strict=True)):
        x, y = number % columns * _SIZE, number // columns * height
        sheet.paste(_photograph(asset), (x, y))
        draw.text((x + 6, y + _SIZE + 4), title[-20:], fill=(40, 42, 48), font=font)
    out = io.BytesIO()
    sheet.save(out, "PNG")
    return out.getvalue()


def _photograph(asset: Asset) -> Image.Image:
    pose = Pose(asset.surface.positions, asset.surface.normals)
    studio = Studio(asset.appearance(), (pose,), size=_SIZE, azimuths_deg=(_AZIMUTH_DEG,))
    return Image.fromarray(studio.photograph(pose, (_AZIMUTH_DEG,))[0], "RGB")
