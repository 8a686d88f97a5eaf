"""The finest level: identities, known goals, pieces that lie close, and many vertices as nodes."""

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from meshdeform.exemplar import surface_fit as module
from meshdeform.exemplar.surface_fit import FitSchedule, SurfaceGoal, surface_fit
from meshdeform.reading.samples import spread

_Array = NDArray[Any]
_MANNER = FitSchedule(samples=4000, rounds=8, stiffness=(3.0, 0.1), limits=(0.2, 0.05), sliding=(0.5, 0.05), held=0.002)


def _ball(detail: int = 4, size: float = 0.3) -> tuple[_Array, _Array]:
    ball = trimesh.creation.icosphere(subdivisions=detail)
    return np.asarray(ball.vertices * size), np.asarray(ball.faces, np.int64)


def _goal(verts: _Array, faces: _Array, code: int = 0) -> SurfaceGoal:
    return SurfaceGoal(spread(verts, faces, 4000, 1), np.full(4000, code), np.full(4000, 1 / 4000))


def _bumpy(verts: _Array) -> _Array:
    """Return a ball's vertices with waves that are too fine for a smooth map of space."""
    bumpy: _Array = verts * (1 + 0.06 * np.sin(25 * verts[:, [0]]) * np.cos(25 * verts[:, [1]]))
    return bumpy


def test_what_lies_on_its_goal_hardly_moves() -> None:
    verts, faces = _ball()
    moved = surface_fit(verts, faces, np.zeros(len(faces), np.int64), _goal(verts, faces), _MANNER)
    assert np.abs(moved - verts).max() < 3e-3


def test_faces_that_are_not_fitted_stay_and_so_does_all_without_a_goal() -> None:
    verts, faces = _ball(3)
    codes = np.where(verts[faces].mean(1)[:, 1] > 0, 0, -1)
    moved = surface_fit(verts, faces, codes, _goal(1.1 * verts, faces), _MANNER)
    still = np.setdiff1d(np.arange(len(verts)), faces[codes == 0])
    assert np.array_equal(moved[still], verts[still])
    assert np.linalg.norm(moved, axis=1).max() > 0.32
    empty = SurfaceGoal(spread(verts, faces, 1, 0).rows(np.zeros(0, np.int64)), np.zeros(0, np.int64), np.zeros(0))
    assert np.array_equal(surface_fit(verts, faces, codes, empty, _MANNER), verts)


def test_fine_waves_are_reached() -> None:
    verts, faces = _ball()
    goal = _bumpy(verts)
    moved = surface_fit(verts, faces, np.zeros(len(faces), np.int64), _goal(goal, faces), _MANNER)
    before, after = np.linalg.norm(verts - goal, axis=1), np.abs(_height(moved) - _height(goal))
    assert before.max() > 0.015
    assert after.mean() < 0.15 * before.mean()


def _height(verts: _Array) -> _Array:
    return np.asarray(np.linalg.norm(verts, axis=1))


def test_only_like_codes_are_paired() -> None:
    verts, faces = _ball(3)
    moved = surface_fit(verts, faces, np.zeros(len(faces), np.int64), _goal(1.1 * verts, faces, 1), _MANNER)
    assert np.abs(moved - verts).max() < 1e-9


def test_a_piece_that_nearly_touches_moves_along() -> None:
    ball, faces = _ball(4)
    eye = 0.03 * trimesh.creation.icosphere(subdivisions=2).vertices + [0, 0, 0.32]
    verts = np.concatenate([ball, eye])
    eye_faces = np.asarray(trimesh.creation.icosphere(subdivisions=2).faces, np.int64)
    codes = np.repeat([0, 5], [len(faces), len(eye_faces)])
    goal = 1.2 * ball
    moved = surface_fit(verts, np.concatenate([faces, eye_faces + len(ball)]), codes, _goal(goal, faces), _MANNER)
    shift = (moved - verts)[len(ball) :]
    assert 0.02 < shift[:, 2].mean() < 0.09


def test_many_vertices_move_as_nodes_to_where_few_do(monkeypatch: Any) -> None:
    verts, faces = _ball(4)
    goal = _goal(verts * [1.0, 1.2, 0.9], faces)
    few = surface_fit(verts, faces, np.zeros(len(faces), np.int64), goal, _MANNER)
    monkeypatch.setattr(module, "_MOST_VERTICES", 1000)
    monkeypatch.setattr(module, "_NODES", 800)
    many = surface_fit(verts, faces, np.zeros(len(faces), np.int64), goal, _MANNER)
    assert np.linalg.norm(many - few, axis=1).mean() < 0.01
    shape = trimesh.Trimesh(many, faces, process=False)
    normals = shape.face_normals[shape.face_adjacency]
    assert (normals[:, 0] * normals[:, 1]).sum(1).min() > 0.7


def test_the_same_bytes_twice() -> None:
    verts, faces = _ball(3)
    codes = np.zeros(len(faces), np.int64)
    results = [surface_fit(verts, faces, codes, _goal(1.1 * verts, faces), _MANNER).tobytes() for _ in range(2)]
    assert results[0] == results[1]
