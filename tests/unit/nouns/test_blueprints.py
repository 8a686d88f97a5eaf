"""Blueprints mean what their head says: numbers, places, copies, mirror images, conditions and bases."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.nouns.families import FAMILIES, KINDS, Traits
from meshdeform.nouns.families.blueprints import BLUEPRINTS, Blueprint, read_blueprints
from meshdeform.nouns.labels import LabelledMember, labelled
from meshdeform.vocabulary.grammar import Attribute


def _drawn(text: str, seed: int = 0, attributes: tuple[Attribute, ...] = ()) -> LabelledMember:
    (blueprint,) = read_blueprints(text).values()
    return labelled("car", blueprint(np.random.default_rng(seed), Traits(attributes)))


def _extents(member: LabelledMember) -> list[NDArray[np.float64]]:
    """Return the extents of each solid, (2, 3): its least and its greatest corner."""
    solids = [member.verts[member.solids == number] for number in range(member.solids.max() + 1)]
    return [np.stack([own.min(0), own.max(0)]) for own in solids]


def test_numbers_are_drawn_between_two_and_build_on_one_another() -> None:
    for seed in range(5):
        (box,) = _extents(_drawn("a: w=.2~.3 h=2w+.5*w*w-.1\n  body box 0,h,0 2w,.2,.4", seed))
        width = box[1, 0] * 2
        assert 0.4 <= width <= 0.6
        middle = box.mean(0)[1]
        assert middle == pytest.approx(width + 0.125 * width**2 - 0.1)


def test_what_is_beside_the_middle_is_on_both_sides_unless_it_is_single() -> None:
    left, right = _extents(_drawn("a:\n  body box .5,0,0 .2,.2,.2"))
    assert left.mean(0) == pytest.approx(right.mean(0) * [-1, 1, 1])
    assert len(_extents(_drawn("a:\n  body box .5,0,0 .2,.2,.2 |"))) == 1
    assert len(_extents(_drawn("a:\n  body box 0,0,0 .2,.2,.2"))) == 1


def test_places_and_copies() -> None:
    row = _extents(_drawn("a:\n  body box 0,1/2,-1:1:5 .2,.2,.2"))
    assert sorted(each.mean(0).round(6).tolist() for each in row) == [
        [0, y, z] for y in (1, 2) for z in (-1, -0.5, 0, 0.5, 1)
    ]
    around = _extents(_drawn("a:\n  body box 0,0,1 .2,.2,.2 *4y"))
    assert sorted(each.mean(0).round(6).tolist() for each in around) == [[-1, 0, 0], [0, 0, -1], [0, 0, 1], [1, 0, 0]]


def test_what_is_done_with_a_solid_is_done_in_order() -> None:
    (turned,) = _extents(_drawn("a:\n  body box 0,0,1 .2,.4,.2 ^x90 @0,1,0 =1,2,1"))
    assert turned.mean(0) == pytest.approx([0, 0, 0])
    assert turned[1] - turned[0] == pytest.approx([0.2, 0.4, 0.4])
    narrow = _drawn("a:\n  body box 0,.5,0 1,1,1 .01 <.5")
    top = narrow.verts[narrow.verts[:, 1] > 0.99]
    assert np.abs(top[:, 0]).max() == pytest.approx(0.25, abs=0.01)


def test_a_condition_leaves_solids_out_and_a_base_is_drawn_first() -> None:
    text = "*wheeled: r=.1 n=?\n  wheel wheel r .05 .5,r,0\n"
    text += "a < *wheeled: r=.2\n  ?n body box 0,0,0 1,1,1; !n lamp box 0,0,0 1,1,1"
    members = [_drawn(text, seed) for seed in range(12)]
    assert {member.parts for member in members} == {("body", "wheel"), ("lamp", "wheel")}
    for member in members:
        assert member.verts[member.solids == 0, 1].max() == pytest.approx(0.4, abs=0.01)


def test_a_size_that_a_prompt_asks_for_is_as_it_says() -> None:
    text = "a: r=wheels:.2\n  wheel wheel r .05 0,r,0"
    small, plain, big = (
        np.ptp(_drawn(text, 1, asked).verts[:, 1])
        for asked in ((Attribute("wheels", "small"),), (), (Attribute("wheels", "big"),))
    )
    assert small < 0.6 * plain < 0.4 * big


def test_a_text_that_is_no_blueprint_is_refused() -> None:
    for text in ("a:\n  body box 0,0,0 1,q,1", "a:\n  body box 0,0,0 1,$,1", "a:\n  body ring 0,0,0", "a: w=2%"):
        with pytest.raises(ValueError, match=r"^a: "):
            _drawn(text)


def test_every_blueprint_is_a_noun_or_a_kind_of_one() -> None:
    for title in BLUEPRINTS:
        noun, _, kind = title.partition("/")
        family = KINDS[noun][kind] if kind else FAMILIES[noun]
        assert isinstance(family, Blueprint)
