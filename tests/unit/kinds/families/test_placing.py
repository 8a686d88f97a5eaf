"""Where a part of a member goes: what is bent to a neighbour, and what is pushed out of it."""

from __future__ import annotations

import numpy as np

from meshdeform.kinds.families.placing import PartFloor, PartSeam, Placing

_PLACES = np.array([[0.0, 0, 0], [0.1, 0, 0]])
_WAYS = np.array([[0.0, 0.02, 0], [0, 0.01, 0]])


def placing(*seams: PartSeam | PartFloor) -> Placing:
    return Placing(np.ones(3), np.zeros(3), seams=list(seams))


def test_places_of_a_seam_go_their_own_ways_and_what_is_far_stays() -> None:
    points = np.concatenate([_PLACES, [[0.0, 0.04, 0], [0, 0.2, 0], [0.1, 0, 0]]])
    patches = np.array([0, 0, 0, 0, 1])
    moved = placing(PartSeam(_PLACES, _WAYS, patch=0, reach=0.08)).moved(points, patches)
    np.testing.assert_allclose(moved[:2], _WAYS, atol=1e-4)
    assert 0 < moved[2, 1] < 0.02
    assert not moved[3:].any()  # out of reach, and on another patch


def test_what_is_bent_stays_smooth() -> None:
    points = np.stack([np.zeros(200), np.linspace(0, 0.2, 200), np.zeros(200)], 1)
    moved = placing(PartSeam(_PLACES, _WAYS, patch=0, reach=0.08)).moved(points, np.zeros(200, int))
    heights = points[:, 1] + moved[:, 1]
    assert (np.diff(heights) > 0).all()  # nothing folds over


def test_what_is_too_deep_goes_up_to_the_floor_and_fades_aside() -> None:
    floor = PartFloor(np.zeros(3), np.array([0.0, 1, 0]), reach=0.1, most=0.05, patch=0)
    points = np.array([[0.0, -0.03, 0], [0.05, 0.02, 0], [0.125, -0.03, 0], [0.2, -0.03, 0], [0, -0.3, 0]])
    moved = placing(floor).moved(points, np.zeros(5, int))
    np.testing.assert_allclose(moved, [[0, 0.03, 0], [0, 0, 0], [0, 0.015, 0], [0, 0, 0], [0, 0.05, 0]], atol=1e-12)
