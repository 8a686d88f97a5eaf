"""Drawings: what is none is told, and what is one looks the same at any size, place and colour."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageOps

from meshdeform.assets.drawing import SIDE, read_drawing
from meshdeform.errors import DrawingError
from meshdeform.sketch.families import FAMILIES
from tests.cases import each_case
from training.sketch.lines import View, joined, visible_lines
from training.sketch.strokes import Hand, draw

EXACT = Hand(shake=0, shift=0, overshoot=0, gaps=0, again=0, lost=0, width=0.008)


def png(picture: Image.Image, kind: str = "PNG") -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, kind)
    return buffer.getvalue()


def page() -> tuple[Image.Image, ImageDraw.ImageDraw]:
    picture = Image.new("L", (300, 300), 255)
    return picture, ImageDraw.Draw(picture)


def chair(size: int = 400) -> Image.Image:
    lines = visible_lines(joined(FAMILIES["chair"].solids({})), View(30, 20, 25))
    return draw(lines, np.random.default_rng(0), EXACT, size)


def test_an_empty_page_is_told() -> None:
    with pytest.raises(DrawingError, match="empty"):
        read_drawing(png(page()[0]))


def test_a_dot_and_a_single_line_are_told() -> None:
    picture, pen = page()
    pen.ellipse((100, 100, 112, 112), fill=0)
    with pytest.raises(DrawingError, match="dot"):
        read_drawing(png(picture))
    picture, pen = page()
    pen.line((30, 40, 240, 200), fill=0, width=3)
    with pytest.raises(DrawingError, match="single line"):
        read_drawing(png(picture))


def test_a_photograph_and_a_filled_shape_are_told() -> None:
    random = np.random.default_rng(0)
    small = Image.fromarray(random.integers(0, 255, (9, 9, 3), np.uint8))
    with pytest.raises(DrawingError, match="photograph"):
        read_drawing(png(small.resize((400, 300), Image.Resampling.BICUBIC), "JPEG"))
    picture, pen = page()
    pen.ellipse((80, 90, 220, 210), fill=40)
    with pytest.raises(DrawingError, match="filled"):
        read_drawing(png(picture))


@each_case("data", [b"", b"no picture", png(chair())[:200]])
def test_what_cannot_be_decoded_is_told(data: bytes) -> None:
    with pytest.raises(DrawingError, match="can be read"):
        read_drawing(data)


def test_a_drawing_looks_the_same_inverted_shifted_and_transparent() -> None:
    picture = chair()
    found = read_drawing(png(picture))
    assert found.shape == (SIDE, SIDE)
    assert found.max() == 1
    ink = found > 0.5
    assert ink.any(0).sum() > 40 or ink.any(1).sum() > 50  # it fills the page
    np.testing.assert_allclose(read_drawing(png(ImageOps.invert(picture))), found, atol=0.05)
    wide = Image.new("L", (500, 460), 255)
    wide.paste(picture, (90, 30))
    np.testing.assert_array_equal(read_drawing(png(wide)), found)
    clear = Image.new("RGBA", picture.size, (0, 0, 0, 0))
    clear.putalpha(ImageOps.invert(picture))
    np.testing.assert_allclose(read_drawing(png(clear)), found, atol=0.05)
