"""Cuts that moved on are none; all others that are new are."""

from __future__ import annotations

import numpy as np

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.moved_cuts import newly_cut
from meshdeform.geometry.shapes import icosphere, join


def two(apart: float) -> TriangleMesh:
    """Two spheres of radius 1 with middles so far apart."""
    ball = icosphere(3)
    return join(ball, TriangleMesh(ball.verts + [apart, 0, 0], ball.faces))


def grown(mesh: TriangleMesh, factor: float) -> np.ndarray:
    """The vertices where the first sphere is larger."""
    count = len(mesh.verts) // 2
    return np.concatenate([factor * mesh.verts[:count], mesh.verts[count:]])


def test_a_part_that_stood_in_another_and_grows_cuts_nothing_anew() -> None:
    mesh = two(1.5)
    assert not newly_cut(mesh.verts, grown(mesh, 1.3), mesh.faces).any()


def test_a_part_that_did_not_cuts_anew_where_it_enters() -> None:
    mesh = two(2.2)
    assert newly_cut(mesh.verts, grown(mesh, 1.3), mesh.faces).sum() > 20


def test_a_cut_far_from_the_earlier_one_is_new() -> None:
    mesh = two(1.5)
    count = len(mesh.verts) // 2
    verts = mesh.verts.copy()
    away = verts[:count, 0] < -0.9  # a thorn from behind, all the way through the other
    verts[:count][away] = [4.0, 0.0, 0.0]
    verts[count:] -= [1e-3, 0, 0]
    found = newly_cut(mesh.verts, verts, mesh.faces)
    pierced = found[len(mesh.faces) // 2 :]
    middles = mesh.verts[mesh.faces].mean(1)
    assert pierced.any()
    assert middles[found][:, 0].max() > 2.3


def test_a_piece_that_folds_through_itself_is_counted_wherever_it_is() -> None:
    ball = icosphere(3)
    verts = np.where(ball.verts[:, :1] > 0.5, ball.verts * [-2.5, 0.3, 0.3], ball.verts)
    assert newly_cut(ball.verts, verts, ball.faces).any()
