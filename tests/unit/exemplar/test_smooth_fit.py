"""The smooth fit: identities, known maps, symmetry, parts, landmarks."""

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.exemplar.smooth_fit import CodedSurface, pulls_to, smooth_fit

_Array = NDArray[Any]
_MIRROR = np.array([-1.0, 1.0, 1.0])


def _ball(stretch: tuple[float, float, float] = (0.3, 0.35, 0.4), detail: int = 4) -> tuple[_Array, _Array]:
    ball = trimesh.creation.icosphere(subdivisions=detail)
    return np.asarray(ball.vertices * stretch), np.asarray(ball.faces, np.int64)


def _bumped() -> tuple[_Array, _Array]:
    """Return a ball with a bump in front, its own mirror image."""
    verts, faces = _ball()
    bump = np.exp(-np.square(verts - [0, 0.1, 0.4]).sum(1) / 0.02)
    return verts + bump[:, None] * [0, 0.02, 0.12], faces


def _fit(verts: _Array, faces: _Array, goal: _Array, goal_faces: _Array, **options: Any) -> _Array:
    return smooth_fit(CodedSurface.alike(verts, faces), CodedSurface.alike(goal, goal_faces), **options)


def _distance(verts: _Array, faces: _Array, goal: _Array, goal_faces: _Array) -> float:
    """Return the mean distance of vertices to a surface, a share of its diagonal."""
    dense = trimesh.Trimesh(goal, goal_faces, process=False).subdivide()
    return float(cKDTree(dense.vertices).query(verts)[0].mean() / np.linalg.norm(np.ptp(goal, axis=0)))


def test_a_goal_without_faces_moves_nothing() -> None:
    verts, faces = _ball(detail=2)
    assert np.array_equal(_fit(verts, faces, np.zeros((0, 3)), np.zeros((0, 3), np.int64)), verts)


def test_parts_without_a_partner_move_nothing() -> None:
    verts, faces = _ball(detail=3)
    codes = np.zeros(len(faces), np.int64)
    moved = smooth_fit(CodedSurface(verts, faces, codes), CodedSurface(verts * 1.2, faces, codes + 1), planes=())
    assert np.abs(moved - verts).max() < 1e-6


@pytest.mark.parametrize("built", [False, True])
def test_itself_as_the_goal_moves_nothing(built: bool) -> None:
    verts, faces = _bumped()
    assert np.abs(_fit(verts, faces, verts, faces, built=built) - verts).max() < 1e-6


def test_an_affine_image_is_reached() -> None:
    verts, faces = _bumped()
    goal = verts * [1.3, 0.8, 1.1] + [0.0, 0.05, -0.03]
    moved = _fit(verts, faces, goal, faces)
    assert _distance(verts, faces, goal, faces) > 0.03
    assert _distance(moved, faces, goal, faces) < 0.005


def test_mirror_images_go_to_mirror_images_exactly() -> None:
    verts, faces = _bumped()
    goal = verts * [1.2, 0.9, 1.1]
    goal[:, 1] += 0.1 * goal[:, 0]  # the goal itself leans
    moved = _fit(verts, faces, goal, faces)
    apart, image = cKDTree(verts).query(verts * _MIRROR)
    same = np.flatnonzero(apart == 0)
    assert len(same) > len(verts) / 2
    assert np.array_equal(moved[same] * _MIRROR, moved[image[same]])


def test_a_mirrored_source_gives_a_mirrored_result() -> None:
    verts, faces = _bumped()
    verts = verts + [[0.2, 0, 0]] * np.square(verts[:, [1]])
    goal = verts * [1.2, 0.9, 1.1]
    moved = _fit(verts, faces, goal, faces, planes=())
    turned = faces[:, ::-1]
    mirrored = _fit(verts * _MIRROR, turned, goal * _MIRROR, turned, planes=())
    assert np.abs(mirrored * _MIRROR - moved).max() < 0.06


def test_scale_and_place_of_both_do_not_matter() -> None:
    verts, faces = _bumped()
    goal = verts * [1.2, 0.9, 1.1]
    moved = _fit(verts, faces, goal, faces)
    place = np.array([3.0, -2.0, 1.0])
    elsewhere = _fit(7 * verts + place, faces, 7 * goal + place, faces)
    assert (elsewhere - place) / 7 == pytest.approx(moved, abs=1e-5)


def test_the_same_bytes_twice() -> None:
    verts, faces = _ball(detail=3)
    goal = verts * [1.2, 0.9, 1.1]
    assert _fit(verts, faces, goal, faces).tobytes() == _fit(verts, faces, goal, faces).tobytes()


def test_nothing_folds_on_the_way_to_what_is_far() -> None:
    verts, faces = _ball((0.3, 0.3, 0.3))
    goal = verts * [0.5, 2.5, 0.4]
    goal[:, 2] += np.square(goal[:, 1])
    moved = _fit(verts, faces, goal, faces)
    assert _distance(moved, faces, goal, faces) < 0.02
    shape = trimesh.Trimesh(moved, faces, process=False)
    assert shape.volume > 0
    neighbours = shape.face_normals[shape.face_adjacency]
    assert (neighbours[:, 0] * neighbours[:, 1]).sum(1).min() > 0


def test_only_like_parts_are_paired() -> None:
    """The upper half has its partner below and the lower one above, so that both change places or stay."""
    verts, faces = _ball()
    front = np.where(verts[faces].mean(1)[:, 2] > 0, 1, 2)
    goal = verts.copy()
    goal[goal[:, 2] > 0] *= [1.0, 1.0, 1.4]
    source = CodedSurface(verts, faces, front)
    moved = smooth_fit(source, CodedSurface(goal, faces, np.where(front == 1, 1, 7)))
    assert np.ptp(moved[:, 2]) > 1.1 * np.ptp(verts[:, 2])
    still = smooth_fit(source, CodedSurface(goal, faces, np.where(front == 1, 7, 2)))
    assert np.ptp(still[:, 2]) < 1.05 * np.ptp(verts[:, 2])


def test_what_may_reach_far_does() -> None:
    verts, faces = _ball(detail=3)
    goal = verts * [1.0, 1.8, 1.0]
    few: dict[str, Any] = {"limits": (0.02, 0.02), "levels": ((3, 2),)}
    near = _fit(verts, faces, goal, faces, **few)
    far = _fit(verts, faces, goal, faces, reach=np.full(len(faces), 15.0), **few)
    assert np.abs(far - goal).max() < 0.5 * np.abs(near - goal).max()


def test_landmarks_pull_their_places_to_their_goals() -> None:
    verts, faces = _ball()
    tip = verts[[verts[:, 2].argmax()]]
    moved = _fit(verts, faces, verts, faces, pulls=pulls_to((tip, tip + [0.0, 0.1, 0.0])))
    free = _fit(verts, faces, verts, faces)
    nearest = verts[:, 2].argmax()
    assert np.linalg.norm(moved[nearest] - tip - [0, 0.1, 0]) < 0.4 * np.linalg.norm(free[nearest] - tip - [0, 0.1, 0])


def test_level_faces_of_what_is_built_stay_level() -> None:
    box = trimesh.creation.box((0.5, 0.3, 0.8))
    for _ in range(4):
        box = box.subdivide()
    verts, faces = np.asarray(box.vertices), np.asarray(box.faces, np.int64)
    goal = verts.copy()
    goal[:, 1] *= 1 + 0.5 * goal[:, 2]  # a wedge
    top = verts[:, 1] > 0.149
    tilted = [np.ptp(_fit(verts, faces, goal, faces, built=built)[top, 1]) for built in (False, True)]
    assert tilted[1] < 0.5 * tilted[0]
