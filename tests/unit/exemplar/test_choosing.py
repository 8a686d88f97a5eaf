"""A member is nearest to itself; what sits finds a member that sits; an unknown front is found by quarter turns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from meshdeform.exemplar.choosing import exemplars
from meshdeform.exemplar.shapes import FitFrame, Shape, Wish
from meshdeform.nouns.forms import drawn
from meshdeform.nouns.labels import LabelledMember
from meshdeform.nouns.poses import posed
from meshdeform.reading.banks import candidate_member
from meshdeform.reading.choice import facing
from meshdeform.reading.result import GROUND, NO_PART
from meshdeform.vocabulary.lookup import Attribute
from tests.cases import each_case


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("banks")


def asset(member: LabelledMember) -> Shape:
    frame = FitFrame.around(member.verts, member.faces, np.eye(3))
    return Shape(member.noun, frame.enter(member.verts), member.faces, member.labels)


def unread(shape: Shape, turn_deg: float = 0.0) -> Shape:
    return Shape("", shape.verts @ facing(-turn_deg).T, shape.faces, np.full(len(shape.faces), NO_PART))


@each_case("noun, number", [("dog", 37), ("bear", 22), ("bird", 5)])
def test_a_member_is_nearest_to_itself_and_lies_on_itself(noun: str, number: int, cache: Path) -> None:
    source = asset(candidate_member(noun, number, ()))
    best = exemplars(source, Wish(noun), 3, cache=cache)[0]
    assert best.told["number"] == number
    np.testing.assert_allclose(best.shape.verts, source.verts, atol=1e-9)
    assert np.array_equal(best.shape.labels, source.labels)


@each_case("pose", ["sitting", "lying"])
def test_the_pose_of_another_noun_is_taken(pose: str, cache: Path) -> None:
    fox = posed(drawn("fox", (), np.random.default_rng(11)), pose, np.random.default_rng(12))
    found = exemplars(asset(fox), Wish("dog"), 3, cache=cache)
    assert [one.told["pose"] for one in found] == [pose] * 3
    assert found[0].merit <= found[1].merit <= found[2].merit


def test_a_bear_on_four_legs_is_taken_for_a_dog_and_a_sitting_one_for_a_sitting_one(cache: Path) -> None:
    dog = drawn("dog", (), np.random.default_rng(3))
    assert exemplars(asset(dog), Wish("bear"), 1, cache=cache)[0].told["form"] == "standing-bear"
    monkey = drawn("monkey", (), np.random.default_rng(3))
    assert exemplars(asset(monkey), Wish("bear"), 1, cache=cache)[0].told["form"] == "bear"


@each_case("turn_deg", [0.0, 90.0, 180.0, -90.0])
def test_where_the_front_is_unknown_quarter_turns_are_tried(turn_deg: float, cache: Path) -> None:
    source = unread(asset(candidate_member("teapot", 5, ())), turn_deg)
    best = exemplars(source, Wish("teapot"), 1, cache=cache)[0]
    assert best.told["turn_deg"] == turn_deg
    assert best.distance < 0.03


def test_what_is_alike_from_all_sides_is_not_turned(cache: Path) -> None:
    ball = unread(asset(drawn("apple", (), np.random.default_rng(7))))
    assert exemplars(ball, Wish("chair"), 1, cache=cache)[0].told["turn_deg"] == 0.0


def test_members_have_the_attributes_and_keep_their_proportions_if_these_are_of_the_whole(cache: Path) -> None:
    source = asset(drawn("vase", (), np.random.default_rng(2)))
    found = {
        degree: exemplars(source, Wish("vase", (Attribute("whole", degree),)), 1, cache=cache)[0]
        for degree in ("tall", "short")
    }
    slim = {}
    for degree, one in found.items():
        assert one.told["attributes"] == [degree]
        member = candidate_member("vase", int(str(one.told["number"])), (Attribute("whole", degree),))
        ratio = np.ptp(one.shape.verts, axis=0) / np.ptp(member.verts, axis=0)
        np.testing.assert_allclose(ratio, ratio[0])
        slim[degree] = np.ptp(one.shape.verts[:, 1]) / np.ptp(one.shape.verts[:, 0])
    assert slim["tall"] > 1.4 * slim["short"]


def test_a_member_stands_on_the_ground_of_the_asset_beside_its_plate(cache: Path) -> None:
    own = asset(drawn("cow", (), np.random.default_rng(2)))
    plate = np.array([[-0.5, -0.4, -0.5], [0.5, -0.4, -0.5], [0, -0.4, 0.9]])
    faces = np.concatenate([own.faces, [np.arange(3) + len(own.verts)]])
    source = Shape("cow", np.concatenate([own.verts, plate]), faces, np.append(own.labels, GROUND))
    with_plate, without = (exemplars(each, Wish("horse"), 1, cache=cache)[0] for each in (source, own))
    assert np.array_equal(with_plate.shape.verts, without.shape.verts)
    assert with_plate.shape.verts[:, 1].min() == pytest.approx(own.verts[:, 1].min())
    assert with_plate.shape.verts[:, 0].min() == pytest.approx(-with_plate.shape.verts[:, 0].max(), abs=1e-6)


def test_seeds_take_members_of_their_own_that_are_still_near(cache: Path) -> None:
    source = asset(drawn("horse", (), np.random.default_rng(2)))
    found = [exemplars(source, Wish("giraffe", seed=seed), 2, cache=cache) for seed in range(5)]
    numbers = [frozenset(str(one.told["number"]) for one in each) for each in found]
    assert sum(map(len, numbers)) == len(frozenset().union(*numbers))
    assert max(each[0].merit for each in found) < 1.6 * found[0][0].merit
    again = exemplars(source, Wish("giraffe", seed=3), 2, cache=cache)
    assert all(np.array_equal(one.shape.verts, two.shape.verts) for one, two in zip(found[3], again, strict=True))
