"""Read a drawing: find its ink, refuse what is no line drawing, and bring it to the size that the network sees."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter, UnidentifiedImageError

from meshdeform.errors import DrawingError, readable_size

SIDE = 64
"""Side of the picture that the network sees."""
MAX_BYTES = 20_000_000
"""Greatest size of a picture's file."""
_MAX_PIXELS = 50_000_000
_LOOKED_AT = 512
"""Longer side to which a picture is made smaller before it is looked at."""
MARGIN = 0.06
"""Empty border of a prepared drawing, as a share of its longer side."""
_INK = 0.25
"""Difference from the paper from which something is ink, as a share of the range from black to white."""
_ADVICE = "Draw the outlines of one thing with dark lines on an even, bright page, large enough to fill most of it."


def read_drawing(data: bytes) -> NDArray[np.float32]:
    """Decode a picture and check that it is a line drawing.

    `data`: PNG, JPEG or WebP. Transparent pixels are paper. Returns (SIDE, SIDE) float32: as `prepared` returns it.
    """
    grey = _decoded(data)
    check_drawing(grey)
    return prepared(grey)


def _decoded(data: bytes) -> Image.Image:
    """Return a picture in grey, reduced."""
    if len(data) > MAX_BYTES:
        raise DrawingError(f"The drawing's file has more than {readable_size(MAX_BYTES)}.", advice=_ADVICE)
    try:
        with Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "WEBP")) as opened:
            if opened.width * opened.height > _MAX_PIXELS:
                raise DrawingError(
                    f"The drawing has {opened.width} x {opened.height} pixels, more than {_MAX_PIXELS:,} in all.",
                    advice="Make it smaller; 1,000 x 1,000 are more than enough.",
                )
            opened.thumbnail((_LOOKED_AT, _LOOKED_AT))
            picture = opened.convert("RGBA")
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise DrawingError("The drawing is no picture that can be read.", advice="Send a PNG, JPEG or WebP.") from error
    page = Image.new("RGBA", picture.size, "white")
    page.alpha_composite(picture)
    return page.convert("L")


def ink_of(picture: Image.Image) -> NDArray[np.float32]:
    """Return how much each pixel differs from the paper (H, W), 0 to 1; the paper is the most frequent brightness."""
    values = np.asarray(picture.convert("L"), np.float32) / 255
    counts = np.convolve(np.histogram(values, 64, (0, 1))[0], np.ones(3), "same")
    paper = (int(counts.argmax()) + 0.5) / 64
    return np.asarray(np.abs(values - paper) / max(paper, 1 - paper), np.float32)


def check_drawing(picture: Image.Image) -> None:
    """Refuse pictures that are no line drawing."""
    ink = ink_of(picture)
    dark = ink > _INK
    if dark.sum() < 12:
        raise DrawingError("The page is empty: there is nothing to recognise.", advice=_ADVICE)
    shades = float((ink > 0.06).mean())
    if shades > 0.45:
        raise DrawingError(
            f"This looks like a photograph or a painting, not like a line drawing: {shades:.0%} of it is not paper.",
            advice=_ADVICE,
        )
    rows, columns = np.flatnonzero(dark.any(1)), np.flatnonzero(dark.any(0))
    height, width = int(rows[-1] - rows[0]) + 1, int(columns[-1] - columns[0]) + 1
    size = max(height, width)
    if size < 0.08 * max(ink.shape) or size < 16:
        raise DrawingError("There is only a dot on the page.", advice=_ADVICE)
    inside = Image.fromarray(dark[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.uint8) * 255)
    wide = max(size // 18, 2) * 2 + 1  # lines are thinner than a ninth of the drawing
    kept = np.asarray(inside.filter(ImageFilter.MinFilter(wide))) > 0 if min(height, width) > wide else dark[:0]
    if kept.sum() > 0.02 * height * width:
        raise DrawingError("This has filled areas instead of lines.", advice=_ADVICE)
    cells = prepared(picture) > 0.3
    if min(height, width) < 0.04 * size or cells.sum() < 1.6 * SIDE:
        raise DrawingError("There is only a single line on the page.", advice=_ADVICE)


def prepared(picture: Image.Image) -> NDArray[np.float32]:
    """Return the ink of a drawing, cut out, centred and at the network's size.

    Returns (SIDE, SIDE) float32: 0 is paper, 1 is ink, whatever the width of the strokes.
    """
    ink = ink_of(picture)
    rows, columns = np.flatnonzero((ink > _INK).any(1)), np.flatnonzero((ink > _INK).any(0))
    cut = ink[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    size = round(max(cut.shape) * (1 + 2 * MARGIN)) + 1
    square = np.zeros((size, size), np.float32)
    top, left = (size - cut.shape[0]) // 2, (size - cut.shape[1]) // 2
    square[top : top + cut.shape[0], left : left + cut.shape[1]] = np.where(cut > 0.06, cut, 0)
    small = np.asarray(Image.fromarray(square).resize((SIDE, SIDE), Image.Resampling.BOX), np.float32)
    inked = small[small > 0.02]
    return np.asarray(np.minimum(small / max(float(np.percentile(inked, 80)), 1e-3), 1.0), np.float32)
