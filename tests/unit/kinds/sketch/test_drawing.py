"""Drawings: what is none is told, and what is one looks the same at any size, place and colour."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageOps

from meshdeform.assets.drawing import SIDE, read_drawing
from meshdeform.errors import DrawingError
from meshdeform.kinds.sketch.lines import BEND, BORDER, OUTLINE, STEP, View, line_pictures
from tests.cases import each_case
from tests.drawings import lines_of


def png(picture: Image.Image, kind: str = "PNG") -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, kind)
    return buffer.getvalue()


def page(mark: Callable[[ImageDraw.ImageDraw], None] | None = None) -> bytes:
    picture = Image.new("L", (300, 300), 255)
    if mark is not None:
        mark(ImageDraw.Draw(picture))
    return png(picture)


def photograph() -> bytes:
    small = Image.fromarray(np.random.default_rng(0).integers(0, 255, (9, 9, 3), np.uint8))
    return png(small.resize((400, 300), Image.Resampling.BICUBIC), "JPEG")


@each_case(
    ("data", "told"),
    [
        (page(), "empty"),
        (page(lambda pen: pen.ellipse((100, 100, 112, 112), fill=0)), "dot"),
        (page(lambda pen: pen.line((30, 40, 240, 200), fill=0, width=3)), "single line"),
        (page(lambda pen: pen.ellipse((80, 90, 220, 210), fill=40)), "filled"),
        (photograph(), "photograph"),
        (b"", "can be read"),
        (b"no picture", "can be read"),
        (page()[:60], "can be read"),
    ],
    ids=["empty", "dot", "line", "filled", "photograph", "nothing", "text", "cut"],
)
def test_what_is_no_drawing_is_told(data: bytes, told: str) -> None:
    with pytest.raises(DrawingError, match=told):
        read_drawing(data)


def test_a_drawing_looks_the_same_inverted_shifted_and_transparent() -> None:
    picture = lines_of("chair", View(30, 20), 400)
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


# Lines: outlines, steps, borders of parts and bends.


def cube(at: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) + [at, 0, 0]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([[a, b, c] for a, b, c, d in sides] + [[a, c, d] for a, b, c, d in sides])


def counted(page: np.ndarray, bit: int) -> int:
    return int(((page & bit) > 0).sum())


def test_a_cube_has_an_outline_and_three_bends_from_a_corner_and_no_bend_from_the_front() -> None:
    verts, faces = cube()
    (_, front), (_, corner) = line_pictures(verts, faces, np.zeros(12, int), [View(0, 0), View(45, 35.26)], 200)
    assert counted(front, BEND) == 0
    side = 200 / 1.12
    assert counted(front, OUTLINE) == pytest.approx(4 * side, rel=0.03)
    # three edges meet at the middle, each as long as half of the page's height
    assert counted(corner, BEND) == pytest.approx(3 * side / 2, rel=0.2)


def test_what_stands_before_something_is_a_step_and_parts_that_meet_have_a_border() -> None:
    verts, faces = cube()
    behind = verts * [3, 3, 1] - [0, 0, 6]
    both, every = np.concatenate([verts, behind]), np.concatenate([faces, faces + 8])
    ((_, page),) = line_pictures(both, every, np.zeros(24, int), [View(0, 0)])
    assert counted(page, STEP) > 60
    assert counted(page, BORDER) == 0
    beside = np.concatenate([verts, cube(2.0)[0]])
    ((_, page),) = line_pictures(beside, every, np.repeat([0, 1], 12), [View(0, 0)])
    assert counted(page, BORDER) > 20
    assert counted(page, STEP) == 0


def test_a_view_that_shows_hardly_anything_is_left_out() -> None:
    verts, faces = cube()
    flat = verts * [1, 0.02, 1]
    shown = line_pictures(flat, faces, np.zeros(12, int), [View(0, 0), View(0, 85)])
    assert [view.elevation_deg for view, _ in shown] == [85]
