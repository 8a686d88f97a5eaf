"""Maps find known motions, keep feet on the ground and wheels round, and are mirror images of each other."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar.affine_maps import Cloud, PieceMotion, articulated, long_axis, rotation_between, touching
from meshdeform.exemplar.blending import blend_weights, blended
from meshdeform.exemplar.pieces import Pieces, pieces_of
from meshdeform.exemplar.shapes import Shape
from meshdeform.nouns.families.parts import Part, box, ellipsoid, join, limb
from meshdeform.nouns.labels import Index, labelled_member
from meshdeform.reading.samples import spread


def cloud_of(verts: np.ndarray, faces: Index, of_face: Index, seed: int = 1) -> Cloud:
    """Return samples of pieces."""
    samples = spread(verts, faces, 1500, seed)
    return Cloud(samples.positions, samples.normals, of_face[samples.faces]).in_pieces()


@pytest.fixture(scope="module")
def horse() -> tuple[Shape, Pieces]:
    member = labelled_member("horse", (), np.random.default_rng(3))
    verts = member.verts / np.linalg.norm(np.ptp(member.verts, axis=0))
    shape = Shape("horse", verts, member.faces, member.labels, member.solid_of_face)
    return shape, pieces_of(shape, {part: part for part in member.parts})


def test_rotations_and_long_axes() -> None:
    turn = rotation_between(np.array([0.0, 2, 0]), np.array([3.0, 0, 0]))
    np.testing.assert_allclose(turn @ [0, 1, 0], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turn), 1)
    np.testing.assert_array_equal(rotation_between(np.eye(3)[0], np.eye(3)[0]), np.eye(3))
    places = np.random.default_rng(0).normal(size=(500, 3)) * [0.1, 1, 0.1]
    axis, longer = long_axis(places, np.array([0.0, 5, 0]))
    assert axis[1] < -0.99
    assert 8 < longer < 12


def test_a_shape_goes_to_a_scaled_copy(horse: tuple[Shape, Pieces]) -> None:
    shape, pieces = horse
    cloud = cloud_of(shape.verts, shape.faces, pieces.of_face)
    scale = np.array([1.2, 0.9, 1.1])
    goal = cloud_of(shape.verts * scale, shape.faces, pieces.of_face)
    partner = np.arange(len(pieces))
    maps = articulated(cloud, goal, pieces.names, partner, touching(cloud, len(pieces), {}), PieceMotion(mirrored=True))
    weights = blend_weights(shape.verts, shape.faces, pieces.of_face, np.zeros(len(pieces), bool))
    np.testing.assert_allclose(weights.sum(1), 1)
    assert weights.min() >= 0
    off = np.linalg.norm(blended(shape.verts, maps, weights) - shape.verts * scale, axis=1)
    assert off.mean() < 0.012


def test_mirror_images_have_mirrored_maps(horse: tuple[Shape, Pieces]) -> None:
    shape, pieces = horse
    cloud = cloud_of(shape.verts, shape.faces, pieces.of_face)
    goal = cloud_of(shape.verts * [1.3, 1, 1], shape.faces, pieces.of_face, 2)
    maps = articulated(cloud, goal, pieces.names, np.arange(len(pieces)), [], PieceMotion(mirrored=True))
    flip = np.array([-1.0, 1, 1])
    points = np.random.default_rng(0).normal(size=(20, 3))
    own = pieces.named("body")[0]
    np.testing.assert_allclose(maps.map_points(points * flip, own), maps.map_points(points, own) * flip, atol=2e-3)


def test_wheels_stay_round_and_feet_on_the_ground() -> None:
    wheel = limb([[-0.02, 0, 0], [0.02, 0, 0]], [0.1, 0.1], segments=24)
    wheel = Part(wheel.verts + [0, -0.2, 0], wheel.faces)
    body = box([0, 0, 0], [0.3, 0.3, 0.6])
    whole = join([body, wheel])
    of_face = np.repeat([0, 1], [len(body.faces), len(wheel.faces)])
    cloud = cloud_of(whole.verts, whole.faces, of_face)
    longer = whole.verts * [1, 1, 1.6]
    longer[len(body.verts) :] = (wheel.verts - [0, -0.3, 0]) * [1, 1.4, 1.4] + [0, -0.3, 0]
    goal = cloud_of(longer, whole.faces, of_face)
    maps = articulated(cloud, goal, ["body", "wheel"], np.array([0, 1]), [], PieceMotion(straight=True))
    stretches = np.diag(maps.linear[1])
    assert abs(stretches[1] / stretches[2] - 1) < 0.02
    assert 1.2 < stretches[1] < 1.6
    moved = maps.map_points(wheel.verts, 1)
    assert abs(moved[:, 1].min() - goal.positions[:, 1].min()) < 0.01


def test_touching_components_are_blended_together() -> None:
    table = join([box([0, 0.2, 0], [0.6, 0.04, 0.6]), box([0.1, 0, 0.1], [0.05, 0.36, 0.05])])
    of_face = np.repeat([0, 1], len(table.faces) // 2)
    weights = blend_weights(table.verts, table.faces, of_face, np.zeros(2, bool))
    top = table.verts[:, 1] > 0.17
    leg = np.arange(len(table.verts)) >= len(table.verts) // 2
    assert weights[leg & top, 1].mean() < weights[leg & ~top, 1].mean()
    apart = blend_weights(table.verts, table.faces, of_face, np.array([False, True]))
    np.testing.assert_allclose(apart[leg, 1], 1)


def test_vertices_without_a_part_follow_the_nearest() -> None:
    balls = join([ellipsoid([-0.3, 0, 0], 0.1), ellipsoid([0.3, 0, 0], 0.1), ellipsoid([0.45, 0, 0], 0.02)])
    count = len(ellipsoid([0, 0, 0], 0.1).faces)
    of_face = np.concatenate([np.repeat([0, 1], count), np.full(len(balls.faces) - 2 * count, -1)])
    weights = blend_weights(balls.verts, balls.faces, of_face, np.zeros(2, bool))
    np.testing.assert_allclose(weights[balls.verts[:, 0] > 0.42, 1], 1, atol=1e-4)
