"""Clay: what counts as a lump, and what it becomes."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar.clay import is_clay, moulded
from meshdeform.exemplar.shapes import Shape
from meshdeform.geometry.shapes import icosphere
from meshdeform.nouns.families.parts import ellipsoid, limb
from meshdeform.nouns.labels import labelled_member


def _shape(part) -> Shape:
    return Shape("", part.verts, part.faces, np.zeros(len(part.faces), np.int64))


def _ball(subdivisions: int) -> Shape:
    mesh = icosphere(subdivisions, 0.3)
    return Shape("", mesh.verts, mesh.faces, np.zeros(len(mesh.faces), np.int64))


def _member(noun: str) -> Shape:
    member = labelled_member(noun, (), np.random.default_rng(1))
    return Shape(noun, member.verts, member.faces, member.labels)


@pytest.mark.parametrize("part", [ellipsoid([0, 0, 0], [0.5, 0.2, 0.3]), limb([[0, 0, 0], [0, 1, 0]], [0.3, 0.3])])
def test_lumps_are_clay(part):
    assert is_clay(_shape(part))


def test_members_with_limbs_are_no_clay():
    assert not is_clay(_member("cow"))


def test_clay_with_seams_is_clay():
    ball = _ball(2)
    corners = ball.verts[ball.faces].reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    assert is_clay(Shape("", corners, faces, np.zeros(len(faces), np.int64)))


def test_an_open_surface_is_no_clay():
    ball = _ball(2)
    assert not is_clay(Shape("", ball.verts, ball.faces[1:], ball.labels[1:]))


def test_a_ball_becomes_the_hull_of_a_member_that_is_convex():
    """The surface is the member's, but for what lies between the vertices."""
    goal = _shape(ellipsoid([0.1, 0.2, 0], [0.5, 0.2, 0.3], rings=28))
    out = moulded(_ball(4), goal)
    off = np.linalg.norm((out - [0.1, 0.2, 0]) / [0.5, 0.2, 0.3], axis=1) - 1
    assert np.abs(off).max() < 0.03


def test_a_mirrored_member_stays_mirrored():
    ball = _ball(3)
    image = np.array([np.linalg.norm(ball.verts - vert * [-1, 1, 1], axis=1).argmin() for vert in ball.verts])
    goal = _member("chair")
    middle = (goal.verts[:, 0].min() + goal.verts[:, 0].max()) / 2
    out = moulded(ball, goal)
    assert np.allclose(out[image], out * [-1, 1, 1] + [2 * middle, 0, 0], atol=1e-9)
