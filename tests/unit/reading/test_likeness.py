"""What a surface is like: members of all nouns are described, and a new member is nearest to those of its noun."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.labels import LabelledMember, labelled_member
from meshdeform.reading.choice import facing
from meshdeform.reading.likeness import Likeness, described, nouns_alike
from meshdeform.reading.samples import spread
from tests.cases import each_case
from training.likeness import reduced


def _member(noun: str) -> LabelledMember:
    return labelled_member(noun, (), np.random.default_rng(4321))


def test_members_of_every_noun_are_described() -> None:
    """Run `python -m training.likeness` if this fails."""
    members = Likeness.read()
    assert list(members.nouns) == list(FAMILIES)
    assert np.bincount(members.noun_of).min() >= 12


@each_case("noun", ["chair", "giraffe", "mug", "piano", "umbrella"])
def test_a_new_member_is_like_its_noun_from_each_side_at_each_size(noun: str) -> None:
    member = _member(noun)
    alike = nouns_alike(member.verts, member.faces)
    assert max(alike, key=lambda each: alike[each]) == noun
    assert sum(alike.values()) == pytest.approx(1)
    turned = nouns_alike(250.0 * member.verts @ facing(90.0).T + [3e3, -70.0, 1e3], member.faces)
    assert turned == pytest.approx(alike, abs=1e-3)


def test_what_is_held_is_known_as_it_lies() -> None:
    member = _member("hammer")
    alike = nouns_alike(member.verts @ np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]).T, member.faces)
    assert max(alike, key=lambda each: alike[each]) == "hammer"


def test_a_plate_under_it_does_not_count() -> None:
    member = _member("giraffe")
    low = member.verts.min(0)
    plate = np.array([[x, low[1] - y, z] for y in (0.0, 0.01) for x, z in ((-2, -2), (-2, 2), (2, 2), (2, -2))])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 1], [1, 4, 5], [2, 6, 3], [3, 6, 7]])
    both = np.concatenate([member.verts, plate]), np.concatenate([member.faces, faces + len(member.verts)])
    assert nouns_alike(*both) == pytest.approx(nouns_alike(member.verts, member.faces), abs=1e-3)


def test_a_description_holds_the_whole_area_and_the_sides_of_the_box() -> None:
    verts = np.array([[0.0, 0, 0], [2, 0, 0], [2, 0, 1], [0, 0, 1], [0, 2, 0]])
    samples = spread(verts, np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4]]), 700, 1)
    found = described(samples.positions, samples.normals, verts.min(0), verts.max(0))
    shares = np.square(found[:-3]).reshape(6, 8, 6, 3)
    np.testing.assert_allclose(shares.sum((0, 1, 2)), [0, 0.5, 0.5], atol=2e-3)  # the floor, and the wall behind it
    assert shares[:, 4:, :, 1].sum() == pytest.approx(0)
    np.testing.assert_allclose(found[-3:], np.array([2, 2, 1]) / 3)


def test_a_mesh_without_area_is_like_nothing() -> None:
    with pytest.raises(ValueError, match="area"):
        nouns_alike(np.zeros((3, 3)), np.array([[0, 1, 2]]))


def test_distances_are_those_of_the_descriptions() -> None:
    rng = np.random.default_rng(5)
    each = {noun: rng.standard_normal((90, 200)) for noun in ("a", "b")}
    held = reduced(each)
    members = Likeness(("a", "b"), np.repeat([0, 1], 90), held["members"] * held["steps"], held["mean"], held["basis"])
    squares = members.distances([each["b"][3], each["a"][7]])
    assert squares[0, 1] == pytest.approx(0, abs=0.05)
    assert squares[1, 0] == pytest.approx(0, abs=0.05)
    assert min(squares[0, 0], squares[1, 1]) > 1
