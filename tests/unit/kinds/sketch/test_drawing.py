"""Drawings: what is none is told, and what is one looks the same at any size, place and colour."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageOps

from meshdeform.assets.drawing import SIDE, read_drawing
from meshdeform.errors import DrawingError, ParameterError
from meshdeform.kinds.sketch.families import FAMILIES, Family
from meshdeform.kinds.sketch.solids import Solid, box, lathe
from tests.cases import each_case
from training.sketch.habits import Habits, drawn_lines
from training.sketch.lines import View, joined, visible_lines
from training.sketch.strokes import Hand, draw
from training.sketch.suggestive import suggestive_contours

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


def test_what_is_behind_a_wall_is_not_seen() -> None:
    wall = box((-2, -2, 2), (2, 2, 2.1))
    alone = visible_lines(joined({"wall": wall}), View(0, 0, 1.0))
    behind = joined({"wall": wall, "cube": box((-0.5, -0.5, 0), (0.5, 0.5, 1))})
    ratio = length(visible_lines(behind, View(0, 0, 1.0))) / length(alone)
    radii = [np.linalg.norm([2, 2, half]) for half in (0.05, 1.05)]  # each picture is fitted to its own sphere
    assert ratio == pytest.approx(radii[0] / radii[1], rel=0.02)
    wire = np.linspace([-1, 0, 3], [1, 0, 3], 9)
    before, after = (
        length(visible_lines(joined({"wall": wall}), View(0, 0, 1.0), [w])) for w in (wire, wire - [0, 0, 2])
    )
    radii = [np.linalg.norm([2, 2, half]) for half in (0.5, 0.55)]
    assert before == pytest.approx((16 + 2) / (2 * radii[0]), rel=0.02)
    assert after == pytest.approx(16 / (2 * radii[1]), rel=0.02)


def test_a_smooth_body_has_only_its_outline() -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 25)
    profile = np.stack([np.cos(angle), np.sin(angle)], 1)
    profile[[0, -1], 0] = 0
    ball = joined({"ball": lathe(profile.tolist(), 48)})
    assert isinstance(ball, Solid)
    lines = visible_lines(ball, View(20, 10, 1.0))
    distances = np.linalg.norm(np.concatenate(lines) - 0.5, axis=1)
    assert distances.min() > 0.45
    # Where the outline jumps between rings, a few of its edges lie behind the ball.
    assert length(lines) == pytest.approx(np.pi, rel=0.1)


def test_suggestive_contours_lie_where_the_radial_curvature_is_zero() -> None:
    y = np.linspace(-1, 1, 61)

    def radius(y: np.ndarray) -> np.ndarray:
        return np.asarray(0.5 + 0.2 * np.cos(3 * y))

    body = joined({"body": lathe([(0, -1), *zip(radius(y), y, strict=True), (0, 1)], 96)})
    eye = np.array([0.0, 6.0, 12.0])
    points, segments = suggestive_contours(body.verts, body.faces, eye)
    assert len(segments) > 20
    r, slope, bend = radius(points[:, 1]), -0.6 * np.sin(3 * points[:, 1]), -1.8 * np.cos(3 * points[:, 1])
    steep = np.sqrt(1 + slope**2)
    out = points * [1, 0, 1] / np.linalg.norm(points * [1, 0, 1], axis=1, keepdims=True)
    around = np.cross(out, [0.0, 1.0, 0.0])
    up = (out * slope[:, None] + [0, 1, 0]) / steep[:, None]
    toward = (eye - points) / np.linalg.norm(eye - points, axis=1, keepdims=True)
    a, b = (toward * up).sum(1), (toward * around).sum(1)
    radial = (-bend / steep**3 * a**2 + b**2 / (r * steep)) / (a**2 + b**2)
    assert np.abs(radial).mean() < 0.05  # of principal curvatures between -1.8 and 3.3
    assert np.abs(radial).max() < 0.3


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
def test_parameters_return_from_shares(family: Family) -> None:
    values = family.draw(np.random.default_rng(3))
    found = family.values(family.shares(values), family.indices(values))
    assert found == {k: pytest.approx(v, abs=1e-4) if isinstance(v, float) else v for k, v in values.items()}
    assert family.checked(family.defaults()) == family.defaults()


@EVERY
def test_every_option_changes_the_shape(family: Family) -> None:
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


# Habits of people who draw: what they leave out and simplify, and that nothing changes without them.


FRONT = Habits(View(0, 12, 20))


def test_without_habits_the_lines_are_those_of_the_mesh() -> None:
    for name, family in FAMILIES.items():
        found = drawn_lines(name, {}, FRONT)
        expected = visible_lines(joined(family.solids({})), FRONT.view)
        assert len(found) == len(expected)
        assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))


def test_far_legs_are_left_out_and_thin_ones_are_single_lines() -> None:
    solids = FAMILIES["table"].solids({})
    for view, left in ((View(0, 12, 20), ("leg_fl", "leg_fr")), (View(90, 12, 20), ("leg_br", "leg_fr"))):
        rest = {name: solid for name, solid in solids.items() if name == "top" or name in left}
        found = drawn_lines("table", {}, Habits(view, legs_left_out=2))
        assert length(found) == pytest.approx(length(visible_lines(joined(rest), view)))
    few = replace(FRONT, legs_left_out=2)
    assert len({length(drawn_lines("lamp", {"base": "tripod"}, habits)) for habits in (few, FRONT)}) == 1

    found = drawn_lines("table", {"inset": 0.1}, Habits(View(0, 0, 12), thin=0.1, legs_left_out=2))
    upright = [line for line in found if np.ptp(line[:, 1]) > 10 * np.ptp(line[:, 0])]
    assert (len(found), len(upright)) == (3, 2)  # with the top
    every = Habits(View(0, 0, 12), thin=0.14, legs_left_out=2, contours=True)
    assert len(drawn_lines("table", {"inset": 0.1, "top_thickness": 0.02}, every)) == 3
    assert sum(line[:, 0].mean() for line in upright) == pytest.approx(1, abs=1e-6)

    # Side panels, which look like legs from the front, are not drawn from there.
    some = [Habits.some("table", {"legs": "sides"}, np.random.default_rng(n)) for n in range(60)]
    assert not [each for each in some if each.legs_left_out == 2 and abs(each.view.azimuth_deg) < 20]
    assert [each for each in some if each.legs_left_out == 2]


def test_propellers_turn_and_depth_goes_up_at_an_angle() -> None:
    for blades in (0, 2, 4):
        across, turned = (
            drawn_lines("airplane", {"engines": "propeller"}, Habits(View(0, 0, 12), blades=blades, turn_deg=turn))
            for turn in (0, 90)
        )
        high, wide = (min(line[:, 1].min() for line in lines) for lines in (turned, across))
        assert (high < wide - 0.01) == (blades == 2)  # a cross and a disc are as high as they are wide
    lines = np.concatenate(drawn_lines("table", {"legs": "sides"}, Habits(View(0, 0, 1), slant=(0.5, 0.5))))
    size = np.ptp(lines, axis=0)
    # The top is 1 wide, 0.7 deep and at 0.6; the side panels begin 0.285 before the middle.
    assert size[0] / size[1] == pytest.approx((1 + 0.35) / (0.6 + 0.5 * (0.35 + 0.285)), rel=0.005)
