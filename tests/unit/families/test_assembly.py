"""Boundaries of parts, their deformation, and how they meet."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.families.boundary import boundary_defects, without_strays
from meshdeform.families.embedded import Embedding, Pull, axis_fit
from meshdeform.sketch.solids import tube


@pytest.fixture(scope="module")
def limb():
    """A tube along y with 24 sections of 16 vertices, and the height of each triangle."""
    solid = tube([(0, 0, 0), (0, 1, 0)], [(0.1, 0.1)] * 2, sides=16, rows=25)
    return solid, solid.verts[solid.faces][:, :, 1].mean(1)


def test_a_cut_around_a_limb_is_clean_and_a_ragged_one_is_not(limb):
    solid, height = limb
    angle = np.arctan2(*solid.verts[solid.faces].mean(1)[:, [0, 2]].T)
    clean = (height > 0.5).astype(np.uint8)
    ragged = (height > 0.5 + 0.15 * np.sign(np.sin(4 * angle))).astype(np.uint8)
    of_clean, of_ragged = (boundary_defects(solid.verts, solid.faces, parts, 3) for parts in (clean, ragged))
    assert of_clean[:2].max() < 0.1
    assert of_ragged[:2].min() > 0.5
    assert np.isinf(of_clean[2])  # no such part
    assert boundary_defects(solid.verts, solid.faces, np.zeros_like(clean), 1) == [0.0]


def test_stray_patches_go_to_the_part_around_them_and_limbs_stay(limb):
    solid, height = limb
    parts = (height > 0.5).astype(np.uint8)
    spotted = parts.copy()
    spotted[np.flatnonzero(height < 0.3)[:6]] = 1
    np.testing.assert_array_equal(without_strays(solid.verts, solid.faces, spotted), parts)
    # Separate solids of one part are no strays, however small they are.
    verts = np.concatenate([solid.verts, 0.1 * solid.verts + 5])
    faces = np.concatenate([solid.faces, solid.faces + len(solid.verts)])
    both = np.concatenate([parts, np.ones_like(parts)])
    np.testing.assert_array_equal(without_strays(verts, faces, both), both)


def test_pulls_to_where_points_are_move_nothing():
    points = np.random.default_rng(0).random((40, 3))
    scale, shift = axis_fit(points, points.copy())
    assert scale.tolist() == [1, 1, 1]
    assert shift.tolist() == [0, 0, 0]
    piece = np.zeros(40, np.int64)
    graph = Embedding(points, piece)
    graph.solve([Pull(points, points.copy(), piece, 1.0)])
    assert not graph.displacement(points + 0.01, piece).any()
    np.testing.assert_array_equal(graph.linear(points, piece), np.tile(np.eye(3), (40, 1, 1)))


def test_a_turn_is_followed_without_shear_and_other_pieces_stay():
    random = np.random.default_rng(1)
    nodes = random.random((60, 3))
    piece = (np.arange(60) >= 40).astype(np.int64)
    angle = 0.5
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    target = np.where(piece[:, None] == 0, nodes @ turn.T, nodes)
    graph = Embedding(nodes, piece)
    graph.solve([Pull(nodes, target, piece, 100.0)])
    inside = random.random((30, 3)) * 0.6 + 0.2
    moved = inside + graph.displacement(inside, np.zeros(30, np.int64))
    assert np.abs(moved - inside @ turn.T).max() < 0.05
    maps = graph.linear(inside, np.zeros(30, np.int64))
    assert np.abs(np.linalg.det(maps) - 1).max() < 0.05
    assert np.abs(graph.displacement(inside, np.ones(30, np.int64))).max() < 1e-6
