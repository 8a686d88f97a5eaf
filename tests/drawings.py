"""Drawings for tests."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from meshdeform.kinds.sketch.families import FAMILIES
from training.sketch.lines import View, joined, visible_lines
from training.sketch.strokes import draw

__all__ = ["blank_page", "drawing_of"]


def drawing_of(family: str, size: int = 300) -> bytes:
    """Return a PNG of a family's default member, drawn as by a hand."""
    lines = visible_lines(joined(FAMILIES[family].solids({})), View(0, 20, 25))
    return _png(draw(lines, np.random.default_rng(0), size=size))


def blank_page() -> bytes:
    """Return a PNG without ink."""
    return _png(Image.new("L", (64, 64), 255))


def _png(picture: Image.Image) -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, "PNG")
    return buffer.getvalue()
