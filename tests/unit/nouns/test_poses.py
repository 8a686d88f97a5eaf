"""A pose moves its limbs and leaves all else; the same generator state gives the same shape."""

from __future__ import annotations

import functools

import numpy as np

from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.forms import FORMS, GENERAL, drawn, is_able, own_forms
from meshdeform.nouns.labels import LabelledMember
from meshdeform.nouns.poses import POSES, limbs, posed
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import PARTS
from tests.cases import each_case

MOVED = {
    "walking": ("leg", "arm"),
    "turned": ("neck", "head"),
    "T": ("arm",),
    "A": ("arm",),
    "hanging": ("arm",),
    "spread": ("wing",),
    "folded": ("wing",),
    "lying": ("leg", "tail"),
}
"""The parts that a pose may move, with what they carry; sitting and swimming move all."""


@functools.cache
def _all() -> list[str]:
    return sorted({form for noun, forms in FORMS.items() for form in (*forms, *own_forms(noun, ()))})


def _parts_of(form: str) -> list[Attribute]:
    attributes = [Attribute(part, degree) for part, degrees in PARTS.items() for degree in degrees]
    return [each for each in attributes if form not in GENERAL and is_able(form, (each,))]


@functools.cache
def _plain(form: str) -> LabelledMember:
    """Return one member of a form, which many tests look at."""
    return drawn(form, (), np.random.default_rng(3))


@each_case("form", _all)
def test_a_form_is_drawn_alike_from_the_same_state(form: str) -> None:
    one, other = _plain(form), drawn(form, (), np.random.default_rng(3))
    assert np.array_equal(one.verts, other.verts)
    assert np.array_equal(one.labels, other.labels)
    assert np.linalg.norm(one.verts, axis=1).max() <= 1 + 1e-9


def test_every_noun_has_forms_and_poses_are_of_forms() -> None:
    assert FORMS.keys() == FAMILIES.keys()
    assert set(POSES) <= set(_all())
    assert "standing-bear" in FORMS["bear"]
    assert {"walking", "sitting", "lying", "turned"} == set(POSES["dog"])


@each_case("form, pose", [(form, pose) for form, poses in POSES.items() for pose in poses])
def test_a_pose_keeps_the_faces_and_the_parts_that_it_does_not_move(form: str, pose: str) -> None:
    rest = drawn(form, (), np.random.default_rng(2))
    one, other = (posed(rest, pose, np.random.default_rng(4)) for _ in range(2))
    assert np.array_equal(one.verts, other.verts)
    assert np.array_equal(one.faces, rest.faces)
    assert np.array_equal(one.labels, rest.labels)
    still = np.ones(len(rest.verts), bool)
    for part in MOVED.get(pose, rest.parts):
        still &= ~rest.carried(part)
    assert np.array_equal(one.verts[still], rest.verts[still])
    assert np.abs(one.verts - rest.verts).max() > 0.01
    if pose not in ("sitting", "swimming"):  # in which knees bend, or all moves
        for part in MOVED[pose]:
            for rows in limbs(rest, part) if part in ("leg", "arm", "wing") and part in rest.parts else []:
                before, after = (
                    np.linalg.norm(shape.verts[rows] - shape.verts[rows[0]], axis=1) for shape in (rest, one)
                )
                np.testing.assert_allclose(after, before, atol=1e-9)


def test_a_lying_animal_is_flat_and_a_sitting_one_upright() -> None:
    rest = drawn("horse", (), np.random.default_rng(1))
    assert np.ptp(posed(rest, "lying", np.random.default_rng(0)).verts[:, 1]) < 0.8 * np.ptp(rest.verts[:, 1])
    dog = drawn("dog", (), np.random.default_rng(1))
    sitting = posed(dog, "sitting", np.random.default_rng(0))
    rows = np.isin(dog.solids, dog.solids_named("body"))
    assert np.ptp(sitting.verts[rows, 1]) > 1.3 * np.ptp(dog.verts[rows, 1])


def test_forms_on_hind_legs_are_upright_with_arms_and_look_ahead() -> None:
    for form in ("upright-dog", "upright-bear"):
        dog = drawn(form, (), np.random.default_rng(1))
        body = dog.verts[np.isin(dog.solids, dog.solids_named("body"))]
        assert np.ptp(body[:, 1]) > 1.5 * np.ptp(body[:, 2])
        assert (len(dog.solids_named("arm")), len(dog.solids_named("leg"))) == (2, 2)
        nose, head = (dog.verts[np.isin(dog.solids, dog.solids_named(part))].mean(0) for part in ("nose", "head"))
        assert (nose - head)[2] > 2 * abs((nose - head)[1])
        assert head[1] > body[:, 1].mean()
    dragon = drawn("two-legged-dragon", (), np.random.default_rng(1))
    assert len(dragon.solids_named("leg")) == 2
    assert np.array_equal(np.unique(dragon.faces), np.arange(len(dragon.verts)))


@each_case("form", lambda: [form for form in _all() if form not in FAMILIES])
def test_a_form_has_the_attributes_that_it_can_have(form: str) -> None:
    plain = _plain(form)
    for attribute in _parts_of(form):
        other = drawn(form, (attribute,), np.random.default_rng(3))
        assert plain.faces.shape == other.faces.shape, attribute
        assert np.abs(plain.verts[plain.faces] - other.verts[other.faces]).max() > 0.02, attribute


def test_what_stands_on_its_hind_legs_is_tall_as_it_stands() -> None:
    tall = drawn("upright-dog", (Attribute("whole", "tall"),), np.random.default_rng(1))
    plain = drawn("upright-dog", (), np.random.default_rng(1))
    slim = [np.ptp(one.verts[:, 1]) / np.ptp(one.verts[:, 0]) for one in (tall, plain)]
    assert slim[0] > 1.3 * slim[1]


def test_a_wing_on_the_flank_is_opened() -> None:
    for form in ("duck", "standing-bird", "swan"):
        rest = drawn(form, (), np.random.default_rng(1))
        spread = posed(rest, "spread", np.random.default_rng(1))
        wing = limbs(rest, "wing")[0]
        assert np.ptp(spread.verts[wing, 0]) > 2 * np.ptp(rest.verts[wing, 0])
        assert np.ptp(spread.verts[wing, 0]) > 1.2 * np.ptp(spread.verts[wing, 2])


def test_wings_that_hang_from_the_middle_of_the_back_stay_there_when_spread() -> None:
    for seed in range(4):  # of a butterfly on the ground, raised by any angle
        spread = posed(drawn("flat-butterfly", (), np.random.default_rng(seed)), "spread", np.random.default_rng(1))
        assert all(np.abs(spread.verts[rows, 0]).min() < 0.05 for rows in limbs(spread, "wing"))
