"""Drawings: what is none is told, and what is one looks the same at any size, place and colour."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageOps

from meshdeform.assets.drawing import SIDE, read_drawing
from meshdeform.errors import DrawingError, ParameterError
from meshdeform.kinds.sketch.families import FAMILIES, Family
from meshdeform.kinds.sketch.solids import box
from tests.cases import each_case
from training.sketch.lines import View, joined, visible_lines
from training.sketch.strokes import Hand, draw

EXACT = Hand(shake=0, shift=0, overshoot=0, gaps=0, again=0, lost=0, width=0.008)


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


def chair(size: int = 400) -> Image.Image:
    lines = visible_lines(joined(FAMILIES["chair"].solids({})), View(30, 20, 25))
    return draw(lines, np.random.default_rng(0), EXACT, size)


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


# Visible lines of a mesh: silhouettes and creases, without what is hidden.


def length(lines: list[np.ndarray]) -> float:
    return sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)


def test_nine_of_twelve_edges_of_a_cube_are_seen_from_a_corner_and_four_from_the_front() -> None:
    cube = joined({"cube": box((-1, -1, -1), (1, 1, 1))})
    # From far away at azimuth 45, edges of length 2 have these lengths on a page whose half size is sqrt(3).
    e = np.radians(35.2643896828)
    flat, upright = np.sqrt(2 + 2 * np.sin(e) ** 2), 2 * np.cos(e)
    expected = (6 * flat + 3 * upright) / (2 * np.sqrt(3))
    assert length(visible_lines(cube, View(45, 35.2643896828, 1.0))) == pytest.approx(expected, rel=0.02)
    assert length(visible_lines(cube, View(0, 0, 1.0))) == pytest.approx(8 / (2 * np.sqrt(3)), rel=0.02)


# Procedural families: closed solids of the stated proportions, and parameters by name.


EVERY = each_case("family", FAMILIES.values(), ids=list(FAMILIES))


@EVERY
def test_solids_are_closed_and_turned_outwards(family: Family) -> None:
    for seed in range(8):
        for name, solid in family.solids(family.draw(np.random.default_rng(seed))).items():
            faces = joined({name: solid}).faces
            edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
            there, back = ({tuple(edge) for edge in each.tolist()} for each in (edges, edges[:, ::-1]))
            assert len(there) == len(edges)
            assert there == back
            corners = solid.verts[solid.faces]
            assert np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) > 0


@EVERY
def test_parameters_return_from_shares_and_every_option_changes_the_shape(family: Family) -> None:
    values = family.draw(np.random.default_rng(3))
    found = family.values(family.shares(values), family.indices(values))
    assert found == {k: pytest.approx(v, abs=1e-4) if isinstance(v, float) else v for k, v in values.items()}
    assert family.checked(family.defaults()) == family.defaults()
    plain = family.solids({})
    for choice in family.choices:
        for option in choice.options[1:]:
            other = family.solids({choice.name: option})
            same = other.keys() == plain.keys() and all(
                np.array_equal(other[name].verts, plain[name].verts) for name in plain
            )
            assert not same, (choice.name, option)


def test_proportions_are_those_that_the_parameters_state() -> None:
    def box(name: str, **values: object) -> tuple[np.ndarray, np.ndarray]:
        verts = joined(FAMILIES[name].solids(values)).verts
        return verts.min(0), verts.max(0)

    low, high = box("table", depth=0.8, height=0.5)
    np.testing.assert_allclose(high - low, [1.0, 0.5, 0.8], atol=1e-12)
    low, high = box("chair", width=0.5, back_height=0.4)
    np.testing.assert_allclose([high[0] - low[0], high[1], low[1]], [0.5, 0.85, 0.0], atol=1e-12)
    low, high = box("airplane", span=1.0, engines="none")
    np.testing.assert_allclose(high[0] - low[0], 2.0, atol=0.02)
    for name in ("vase", "goblet", "lamp"):
        low, high = box(name)
        np.testing.assert_allclose([low[1], high[1]], [0.0, 1.0], atol=1e-9)


@each_case("values", [{"wings": 2}, {"width": 7}, {"width": "wide"}, {"width": float("nan")}, {"legs": "x"}])
def test_parameters_that_do_not_exist_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ParameterError):
        FAMILIES["chair"].solids(values)
