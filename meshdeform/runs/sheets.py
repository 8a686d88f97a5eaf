"""Draw shapes and assets in rows: the sheets of families, words and drawings."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from meshdeform.assets import Asset, Limits, Primitive, build_glb, load_asset
from meshdeform.rendering.studio import Studio, SurfaceState

__all__ = ["COLOURS", "assets_png", "family_png", "shown"]

COLOURS = (
    (0.00, 0.17, 0.45, 1.0),
    (0.73, 0.27, 0.00, 1.0),
    (0.00, 0.34, 0.17, 1.0),
    (0.60, 0.05, 0.25, 1.0),
    (0.85, 0.60, 0.02, 1.0),
    (0.10, 0.45, 0.75, 1.0),
    (0.30, 0.15, 0.50, 1.0),
    (0.25, 0.25, 0.25, 1.0),
    (0.45, 0.70, 0.20, 1.0),
    (0.90, 0.40, 0.45, 1.0),
    (0.30, 0.62, 0.60, 1.0),
    (0.30, 0.16, 0.07, 1.0),
)
"""Linear RGBA by part; after the last, the first again."""

_SIZE, _AZIMUTH_DEG, _MARGIN, _LINE, _INK = 160, 35.0, 28, 20, (40, 42, 48)
Shown = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]
_MOST_SHAPES = 120


def family_png(shapes: Sequence[Shown], parts: Sequence[str]) -> bytes:
    """Draw shapes in rows, with the names of the parts in their colours below.

    `shapes` is sequence of (positions (N, 3), triangles (F, 3), part of each triangle (F,)).
    """
    drawn, _ = _in_rows([_drawn(shape) for shape in shapes])
    font, lines = ImageFont.load_default(14), [[0]]
    widths = [36 + round(font.getlength(part)) for part in parts]
    for number in range(1, len(parts)):
        fits = sum(widths[each] for each in [*lines[-1], number]) <= drawn.width
        lines[-1:] = [[*lines[-1], number]] if fits else [lines[-1], [number]]
    sheet = Image.new("RGB", (drawn.width, drawn.height + _MARGIN + _LINE * (len(lines) - 1)), (255, 255, 255))
    sheet.paste(drawn, (0, 0))
    draw = ImageDraw.Draw(sheet)
    for line, numbers in enumerate(lines if parts else []):
        x, y = 10, drawn.height + 6 + _LINE * line
        for number in numbers:
            colour = tuple(round(255 * value ** (1 / 2.2)) for value in COLOURS[number % len(COLOURS)][:3])
            draw.rectangle((x, y + 2, x + 12, y + 14), fill=colour)
            draw.text((x + 18, y), parts[number], fill=_INK, font=font)
            x += widths[number]
    return _png(sheet)


def _drawn(shape: Shown) -> Image.Image:
    positions, triangles, colours = shape
    coloured = []
    for part in np.unique(colours):
        rows, faces = np.unique(triangles[colours == part], return_inverse=True)
        colour = COLOURS[part % len(COLOURS)]
        coloured.append(Primitive(positions[rows], faces.reshape(-1, 3), material=f"part {part}", base_color=colour))
    asset = load_asset(build_glb(coloured), "shape.glb", Limits.unlimited())
    return _photograph(asset)


def assets_png(assets: Iterable[Asset], titles: Sequence[str]) -> bytes:
    """Draw assets in rows as their materials show them, each above its title."""
    sheet, corners = _in_rows([_photograph(asset) for asset in assets], between=_MARGIN)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for (x, y), title in zip(corners, titles, strict=True):
        draw.text((x + 6, y + _SIZE + 4), title[-20:], fill=_INK, font=font)
    return _png(sheet)


def _in_rows(pictures: Sequence[Image.Image], *, between: int = 0) -> tuple[Image.Image, list[tuple[int, int]]]:
    """Return a sheet of pictures, with pixels left under each row, and the upper left corner of each."""
    columns = min(max(math.ceil(math.sqrt(len(pictures) * 1.5)), 3), len(pictures))
    rows, height = -(-len(pictures) // columns), _SIZE + between
    sheet = Image.new("RGB", (columns * _SIZE, rows * height), (255, 255, 255))
    corners = [(number % columns * _SIZE, number // columns * height) for number in range(len(pictures))]
    for picture, corner in zip(pictures, corners, strict=True):
        sheet.paste(picture, corner)
    return sheet, corners


def _png(sheet: Image.Image) -> bytes:
    out = io.BytesIO()
    sheet.save(out, "PNG")
    return out.getvalue()


def _photograph(asset: Asset) -> Image.Image:
    pose = SurfaceState(asset.surface.positions, asset.surface.normals)
    studio = Studio(asset.appearance(), (pose,), size=_SIZE, azimuths_deg=(_AZIMUTH_DEG,))
    return Image.fromarray(studio.photograph(pose, (_AZIMUTH_DEG,))[0], "RGB")


def shown(count: int) -> range:
    """Return which of `count` shapes a wall shows: all, or every second, third ... one."""
    return range(0, count, -(-count // _MOST_SHAPES))
