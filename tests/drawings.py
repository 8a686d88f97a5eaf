"""Drawings for tests."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image, ImageFilter

from meshdeform.kinds.sketch.lines import View, line_pictures
from meshdeform.kinds.sketch.shapes import shape

__all__ = ["blank_page", "drawing_of", "lines_of"]


def lines_of(noun: str, view: View | None = None, pixels: int = 300, **values: object) -> Image.Image:
    """Return the lines of a shape of a noun, as wide as those of a pen; from the side by default."""
    made = shape(noun, values)
    ((_, page),) = line_pictures(made.verts, made.faces, made.labels, [view or View(90, 6)], pixels)
    return Image.fromarray(np.where(page > 0, 0, 255).astype(np.uint8)).filter(ImageFilter.MinFilter(3))


def drawing_of(noun: str, view: View | None = None, **values: object) -> bytes:
    """Return a PNG of the lines of a shape of a noun."""
    return _png(lines_of(noun, view, 300, **values))


def blank_page() -> bytes:
    """Return a PNG without ink."""
    return _png(Image.new("L", (64, 64), 255))


def _png(picture: Image.Image) -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, "PNG")
    return buffer.getvalue()
