"""Every part of every noun has a role; legs, wheels and ears are single pieces; like pieces match by place."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar.alike import grows_from, made_alike
from meshdeform.exemplar.pieces import matched, pieces_of
from meshdeform.exemplar.shapes import Shape
from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.families.parts import box, ellipsoid, join
from meshdeform.nouns.labels import code, labelled_member
from meshdeform.reading.result import GROUND, NO_PART

_GOALS = ("horse", "table", "truck", "person", "burger", "vase")


def shape_of(noun: str, seed: int = 1) -> Shape:
    """Return a member in the frame of fits."""
    member = labelled_member(noun, (), np.random.default_rng(seed))
    size = float(np.linalg.norm(np.ptp(member.verts, axis=0)))
    return Shape(noun, member.verts / size, member.faces, member.labels, member.solid_of_face)


def parts(shape: Shape) -> dict[str, str]:
    """Return the parts of a shape under their own names."""
    member = labelled_member(shape.noun, (), np.random.default_rng(1))
    return {part: part for part in member.parts}


@pytest.mark.parametrize(
    ("noun", "counts"),
    [
        ("horse", {"leg": 4, "ear": 2, "tail": 1}),
        ("giraffe", {"horn": 2, "leg": 4}),
        ("car", {"wheel": 4, "cabin": 1}),
        ("motorcycle", {"wheel": 2}),
        ("person", {"arm": 2, "leg": 2, "body": 1}),
        ("dolphin", {"fin": 3}),
        ("castle", {"tower": 4}),
    ],
)
def test_a_part_that_a_noun_has_more_than_once_is_in_several_pieces(noun: str, counts: dict[str, int]) -> None:
    shape = shape_of(noun)
    pieces = pieces_of(shape, parts(shape))
    assert {name: len(pieces.named(name)) for name in counts} == counts
    assert set(np.unique(pieces.of_face)) == set(range(len(pieces)))


def test_legs_that_meet_in_the_middle_are_two() -> None:
    legs = join(
        [box([-0.1, 0, 0], [0.18, 0.5, 0.1]), box([0.1, 0, 0], [0.18, 0.5, 0.1]), box([0, 0.2, 0], [0.04, 0.04, 0.1])]
    )
    shape = Shape("person", legs.verts, legs.faces, np.full(len(legs.faces), code("leg")))
    pieces = pieces_of(shape, {"leg": "leg"})
    assert len(pieces) == 2
    sides = np.sign(legs.verts[legs.faces].mean(1)[:, 0])
    assert abs(np.corrcoef(sides, pieces.of_face)[0, 1]) > 0.9


def test_ground_and_unknown_faces_are_of_no_piece() -> None:
    shape = join([ellipsoid([0, 0, 0], 0.3), box([0, -0.3, 0], [0.8, 0.02, 0.8])])
    labels = np.full(len(shape.faces), code("body"))
    labels[-12:], labels[:5] = GROUND, NO_PART
    pieces = pieces_of(Shape("bear", shape.verts, shape.faces, labels), {"body": "body"})
    assert (pieces.of_face[-12:] == -1).all()
    assert (pieces.of_face[:5] == -1).all()
    assert len(pieces) == 1


def test_names_are_made_alike() -> None:
    bird, person = (
        {"body", "head", "beak", "wing", "leg", "foot"},
        {"body", "head", "nose", "arm", "hand", "leg", "foot"},
    )
    one, other = made_alike(bird, person, "bird", "person")
    assert one["wing"] == other["arm"] == other["hand"]
    assert one["beak"] == other["nose"]
    assert one["foot"] == other["foot"] == "leg"
    tree, mushroom = made_alike({"trunk", "crown"}, {"stem", "cap"}, "tree", "mushroom")
    assert tree["trunk"] == mushroom["stem"]
    assert tree["crown"] == mushroom["cap"]


def test_every_pair_of_nouns_gets_names() -> None:
    all_parts = {noun: set(parts(shape_of(noun))) for noun in [*FAMILIES][::4]}
    for goal in _GOALS:
        all_parts[goal] = set(parts(shape_of(goal)))
    for noun in all_parts:
        one, other = made_alike(all_parts[noun], all_parts[noun], noun, noun)
        assert one == other
        for goal in _GOALS:
            own, its = made_alike(all_parts[noun], all_parts[goal], noun, goal)
            assert set(own) == all_parts[noun]
            assert set(its) == all_parts[goal]
            back, forth = made_alike(all_parts[goal], all_parts[noun], goal, noun)
            assert set(back) == set(its)
            assert set(forth) == set(own)


def test_a_shape_matches_itself() -> None:
    for noun in ("horse", "truck", "person", "chair"):
        shape = shape_of(noun)
        match = matched(shape, shape)
        np.testing.assert_array_equal(match.partner, np.arange(len(match.source)))
        np.testing.assert_array_equal(match.parent, np.arange(len(match.goal)))
        assert not match.grows.any()


def test_legs_match_by_place_and_what_is_missing_grows_from_its_carrier() -> None:
    match = matched(shape_of("horse"), shape_of("elephant"))
    centre = {}
    for name, shape, pieces in (("own", shape_of("horse"), match.source), ("goal", shape_of("elephant"), match.goal)):
        middles = shape.verts[shape.faces].mean(1)
        centre[name] = [middles[pieces.of_face == k].mean(0) for k in range(len(pieces))]
    for leg in match.source.named("leg"):
        assert (np.sign(centre["own"][leg][[0, 2]]) == np.sign(centre["goal"][match.partner[leg]][[0, 2]])).all()
    trunk = match.goal.named("trunk")[0]
    assert match.grows[trunk]
    assert match.source.names[match.parent[trunk]] == "head"
    assert match.source.names[match.parent[match.goal.named("leg")[0]]] == "leg"


def test_parts_grow_from_what_is_there() -> None:
    assert grows_from("ear", ["body", "head"]) == "head"
    assert grows_from("ear", ["body"]) == "body"
    assert grows_from("wheel", ["leg"]) is None
