"""Maps of surfaces to the sphere: one to one, with a share for each part; balls in sets of nodes."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar.balls import ball_within, connected
from meshdeform.exemplar.outer_surface import outer_surface
from meshdeform.exemplar.spherical import sphere_map
from meshdeform.geometry.isosurface import isosurface
from meshdeform.nouns.labels import labelled_member


def _characteristic(faces) -> int:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return len(np.unique(faces)) - len(np.unique(edges, axis=0)) + len(faces)


@pytest.mark.parametrize(("noun", "characteristic"), [("chair", 1), ("mug", 2)])
def test_a_member_goes_to_the_sphere_without_folds(noun, characteristic):
    member = labelled_member(noun, (), np.random.default_rng(1))
    surface = outer_surface(member.verts, member.faces)
    assert _characteristic(surface.faces) == characteristic
    mapped = sphere_map(surface.verts, surface.faces, 800, mirrored=surface.plane is not None)
    a, b, c = mapped.directions[mapped.faces].transpose(1, 0, 2)
    assert _characteristic(mapped.faces) == characteristic
    assert ((np.cross(a, b) * c).sum(1) > 0).all()
    angles = 2 * np.arctan2((np.cross(a, b) * c).sum(1), 1 + (a * b).sum(1) + (b * c).sum(1) + (c * a).sum(1))
    assert angles.sum() == pytest.approx(2 * np.pi * characteristic)


def _ring() -> np.ndarray:
    at = np.stack(np.meshgrid(*[np.arange(20) - 9.5] * 3, indexing="ij"), -1)
    return np.hypot(np.hypot(at[..., 0], at[..., 1]) - 5.5, at[..., 2]) < 2.2


def test_a_ring_is_cut():
    ring = connected(_ring(), mirrored=False)
    ball = ball_within(ring, mirrored=False)
    faces = isosurface(np.where(ball, -1.0, 1.0), np.zeros(3), np.ones(3))[1]
    assert _characteristic(faces) == 2
    assert 0 < (ring & ~ball).sum() < 0.1 * ring.sum()


def test_pieces_are_joined_and_cavities_filled():
    nodes = np.zeros((20, 12, 12), bool)
    nodes[2:8, 3:9, 3:9] = nodes[12:18, 3:9, 3:9] = True
    nodes[4:6, 5:7, 5:7] = False
    whole = connected(nodes, mirrored=False)
    assert whole[4:6, 5:7, 5:7].all()
    assert ball_within(whole, mirrored=False).sum() == whole.sum()
