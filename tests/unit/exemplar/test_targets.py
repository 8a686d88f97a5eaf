"""Given surfaces: how close a surface comes to one, its mirror images, and landmarks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.targets import fitted_to_target
from meshdeform.nouns.families.parts import Part, ellipsoid, join
from meshdeform.reading.samples import spread

_Array = NDArray[Any]


def _shape(part: Part) -> Shape:
    return Shape("", part.verts, part.faces, np.full(len(part.faces), -1))


def _bird(beak: float = 0.1, rings: int = 24) -> Shape:
    """Return a body with a head in front and above, its own mirror image across x."""
    body, head = ellipsoid([0, 0, 0], [0.2, 0.18, 0.35], rings=rings), ellipsoid([0, 0.2, 0.3], 0.13, rings=rings)
    return _shape(join([body, head, ellipsoid([0, 0.2, 0.43], [0.04, 0.03, beak], rings=rings)]))


def _distance(shape: Shape, verts: _Array, goal: Shape) -> float:
    """Return the mean distance of the vertices of a shape to a goal, a share of its diagonal."""
    places = spread(goal.verts, goal.faces, 60_000, 0).positions
    return float(cKDTree(places).query(verts)[0].mean() / np.linalg.norm(np.ptp(goal.verts, axis=0)))


def test_a_surface_comes_close_to_its_target() -> None:
    ball, goal = _shape(ellipsoid([0, 0, 0], 0.3, rings=40)), _shape(ellipsoid([0, 0, 0], [0.2, 0.3, 0.4], rings=40))
    moved = fitted_to_target(ball, goal, planes=(0,))
    assert _distance(ball, ball.verts, goal) > 0.03
    assert _distance(ball, moved, goal) < 0.004


def test_mirror_images_stay_mirror_images() -> None:
    ball = _shape(ellipsoid([0, 0, 0], 0.3, rings=24))
    moved = fitted_to_target(ball, _bird(), planes=(0,))
    far, image = cKDTree(ball.verts).query(ball.verts * [-1, 1, 1])
    assert far.max() < 1e-9
    assert np.abs(moved[image] * [-1, 1, 1] - moved).max() < 1e-9


def test_landmarks_pull_places_to_their_goals() -> None:
    ball = _shape(ellipsoid([0, 0, 0], 0.3, rings=24))
    tip = ball.verts[[ball.verts[:, 2].argmax()]]
    goal = np.array([[0.0, 0.15, 0.26]])
    free = fitted_to_target(ball, ball)
    pulled = fitted_to_target(ball, ball, landmarks=(tip, goal))
    nearest = int(ball.verts[:, 2].argmax())
    assert np.linalg.norm(pulled[nearest] - goal) < 0.5 * np.linalg.norm(free[nearest] - goal)
