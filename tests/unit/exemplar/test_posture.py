"""Postures are told apart by the directions of limbs, and a member takes those of an asset."""

from __future__ import annotations

import numpy as np

from meshdeform.exemplar.posture import Posture, held_like, postures, unlikeness
from meshdeform.nouns.forms import drawn
from meshdeform.nouns.labels import LabelledMember
from meshdeform.nouns.limbs import LIMBS, limb_codes
from meshdeform.nouns.poses import limbs, posed
from meshdeform.reading.samples import spread
from tests.cases import each_case


def posture(member: LabelledMember) -> Posture:
    samples = spread(member.verts, member.faces, 1500, 1)
    codes = limb_codes(member)[samples.faces]
    low, high = member.verts.min(0), member.verts.max(0)
    return postures(samples.positions[None], codes[None], low[None], high[None])[0]


def in_pose(noun: str, pose: str, seed: int = 4) -> LabelledMember:
    return posed(drawn(noun, (), np.random.default_rng(seed)), pose, np.random.default_rng(seed))


def test_limbs_and_their_directions_are_found() -> None:
    horse = posture(drawn("horse", (), np.random.default_rng(1)))
    assert sorted(LIMBS[kind] for kind in horse.kinds) == ["body", "head", *["leg"] * 4, "neck", "tail"]
    legs = horse.axes[horse.kinds == LIMBS.index("leg")]
    np.testing.assert_allclose(legs, np.tile([0, -1, 0], (4, 1)), atol=0.2)
    (body,) = horse.axes[horse.kinds == LIMBS.index("body")]
    assert abs(body[2]) > 0.98


def test_a_body_is_like_itself_and_less_like_one_in_another_pose() -> None:
    rest, other = drawn("dog", (), np.random.default_rng(4)), drawn("wolf", (), np.random.default_rng(5))
    assert unlikeness(posture(rest), posture(rest)) == 0.0
    near = unlikeness(posture(rest), posture(other))
    for pose in ("sitting", "lying", "walking"):
        assert unlikeness(posture(other), posture(in_pose("dog", pose))) > near + 0.05
    assert unlikeness(posture(rest), posture(drawn("mug", (), np.random.default_rng(1)))) == 0.0


@each_case("noun, goal, part", [("giraffe", "horse", "leg"), ("deer", "cow", "leg"), ("robot", "person", "arm")])
def test_a_member_takes_the_directions_of_limbs(noun: str, goal: str, part: str) -> None:
    asset = in_pose(goal, {"leg": "walking", "arm": "T"}[part])
    member = drawn(noun, (), np.random.default_rng(2))
    before, after = (unlikeness(posture(asset), posture(one)) for one in (member, held_like(member, posture(asset))))
    assert after < 0.6 * before
    own, moved = limbs(member, part)[0], held_like(member, posture(asset))
    length = [np.linalg.norm(shape.verts[own] - shape.verts[own[0]], axis=1) for shape in (member, moved)]
    np.testing.assert_allclose(length[0], length[1], atol=1e-9)


def test_who_has_no_limbs_stays() -> None:
    mug = drawn("mug", (), np.random.default_rng(1))
    moved = held_like(mug, posture(drawn("dog", (), np.random.default_rng(1))))
    assert np.array_equal(moved.verts, mug.verts)
