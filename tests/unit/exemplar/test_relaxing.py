"""The last stage of a fit: a surface slides along its goal until it is distorted less."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar import relaxing, surface_fit
from meshdeform.exemplar.relaxing import relaxed
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.nouns.labels import Floats

_BALL = icosphere(3)
_VERTS, _FACES = _BALL.verts, _BALL.faces
_FINE = icosphere(4)


def _slid(verts: Floats, share: float) -> Floats:
    """Slide places of the unit sphere toward its north pole."""
    moved = verts + [0, share, 0]
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))


def _distortion(verts: Floats) -> float:
    return measure(_VERTS, _FACES, verts).symmetric_dirichlet_mean


def test_a_surface_that_is_its_goal_stays() -> None:
    assert np.allclose(relaxed(_VERTS, _VERTS, _FACES, _VERTS, _FACES), _VERTS, atol=1e-6)


def test_it_slides_back_along_the_goal() -> None:
    start = _slid(_VERTS, 0.5)
    moved = relaxed(_VERTS, start, _FACES, _FINE.verts, _FINE.faces, stiffness=0.01)
    assert _distortion(moved) - 1 < 0.5 * (_distortion(start) - 1)
    assert np.abs(np.linalg.norm(moved, axis=1) - 1).max() < 0.02


def test_a_stiffer_surface_slides_less() -> None:
    start, goal = _slid(_VERTS, 0.5), (_FINE.verts, _FINE.faces)
    soft, stiff = (relaxed(_VERTS, start, _FACES, *goal, stiffness=each) for each in (1.0, 1e4))
    assert np.abs(stiff - start).max() < np.abs(soft - start).max()


def test_a_scaled_surface_is_not_distorted() -> None:
    start = 1.7 * _VERTS
    assert np.allclose(relaxed(_VERTS, start, _FACES, start, _FACES), start, atol=1e-6)


def test_many_vertices_move_by_fewer_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface_fit, "_MOST_VERTICES", 100)
    monkeypatch.setattr(surface_fit, "_NODES", 200)
    start = _slid(_VERTS, 0.5)
    moved = relaxed(_VERTS, start, _FACES, _FINE.verts, _FINE.faces)
    assert _distortion(moved) < _distortion(start)


def test_faces_without_area_do_not_count() -> None:
    faces = np.concatenate([_FACES, [[0, 0, 1]]])
    moved = relaxed(_VERTS, _slid(_VERTS, 0.3), faces, _VERTS, _FACES)
    assert np.isfinite(moved).all()


def test_a_slit_stays_closed() -> None:
    right = (_VERTS[_FACES].mean(1)[:, 0] > 0)[:, None]
    halves = np.concatenate([_VERTS, _VERTS])
    faces = np.where(right, _FACES, _FACES + len(_VERTS))
    seam = np.intersect1d(_FACES[right[:, 0]], _FACES[~right[:, 0]])
    start = np.concatenate([_slid(_VERTS, 0.3), _slid(_VERTS, 0.3)])
    moved = relaxed(halves, start, faces, _FINE.verts, _FINE.faces, stiffness=0.01)
    step = moved - start
    assert np.linalg.norm(step[seam], axis=1).max() > 1e-3
    assert np.linalg.norm(step[seam] - step[seam + len(_VERTS)], axis=1).max() < 5e-3


def test_a_surface_of_very_many_faces_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    start = _slid(_VERTS, 0.5)
    monkeypatch.setattr(relaxing, "_MOST_FACES", len(_FACES) - 1)
    assert relaxed(_VERTS, start, _FACES, _VERTS, _FACES) is start
    monkeypatch.setattr(relaxing, "_MOST_FACES", len(_FACES))
    assert relaxed(_VERTS, start, _FACES, _VERTS, _FACES) is not start
