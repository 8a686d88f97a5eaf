"""Procedural families: closed solids of the stated proportions, and parameters by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshdeform.errors import ParameterError
from meshdeform.sketch.families import FAMILIES, Family
from tests.cases import each_case
from training.sketch.habits import Habits, drawn_lines
from training.sketch.lines import View, joined, visible_lines

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


def length(lines: list[np.ndarray]) -> float:
    return sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)


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
    lamp = {"base": "tripod"}
    assert length(drawn_lines("lamp", lamp, replace(FRONT, legs_left_out=2))) == length(
        drawn_lines("lamp", lamp, FRONT)
    )

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
