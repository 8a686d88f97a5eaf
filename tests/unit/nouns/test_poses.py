"""A pose moves its limbs and leaves all else; the same generator state gives the same shape."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.forms import FORMS, drawn
from meshdeform.nouns.poses import POSES, limbs, posed
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
"""The parts that a pose may move, with what they carry; sitting moves all."""


@each_case("form", sorted({form for forms in FORMS.values() for form in forms}))
def test_a_form_is_drawn_alike_from_the_same_state(form: str) -> None:
    one, other = (drawn(form, (), np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(one.verts, other.verts)
    assert np.array_equal(one.labels, other.labels)
    assert np.linalg.norm(one.verts, axis=1).max() <= 1 + 1e-9


def test_every_noun_has_forms_and_poses_are_of_forms() -> None:
    assert FORMS.keys() == FAMILIES.keys()
    assert set(POSES) <= {form for forms in FORMS.values() for form in forms}
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
    if pose != "sitting":  # whose knees bend
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
