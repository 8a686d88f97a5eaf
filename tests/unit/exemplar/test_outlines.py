"""Outlines: contours of masks, where they are seen, and surfaces that take them on."""

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from meshdeform.exemplar.outlines import Outline, Outlines, contour_of, outlined, outlines_of
from meshdeform.exemplar.smooth_fit import CodedSurface, smooth_fit
from meshdeform.geometry.pictures import SilhouetteView

_Array = NDArray[Any]


def _ball(detail: int = 4) -> tuple[_Array, _Array]:
    ball = trimesh.creation.icosphere(subdivisions=detail)
    return np.asarray(0.3 * ball.vertices), np.asarray(ball.faces, np.int64)


def _ellipse(wide: float, high: float, count: int = 200) -> tuple[_Array, _Array]:
    """Return points of an ellipse of half axes, and normals."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    normals = np.column_stack([np.cos(angle) / wide, np.sin(angle) / high])
    return (
        np.column_stack([wide * np.cos(angle), high * np.sin(angle)]),
        normals / np.linalg.norm(normals, axis=1)[:, None],
    )


def _outline(
    azimuth_deg: float, elevation_deg: float, points: _Array, normals: _Array, distance: float = 1e9
) -> Outline:
    """Return the outline seen from a direction, by default from so far away that all rays are parallel."""
    view = SilhouetteView(np.zeros((0, 0), bool), azimuth_deg, elevation_deg)
    return Outline(view.right, view.up, points, normals, distance)


def _mask(wide: float, high: float, side: int = 120) -> _Array:
    """Return the mask of an ellipse with half axes in pixels."""
    rows, columns = np.mgrid[:side, :side] + 0.5
    return np.asarray(((columns - side / 2) / wide) ** 2 + ((rows - side / 2) / high) ** 2 < 1)


def test_the_contour_of_a_disc_is_a_circle() -> None:
    points, normals = contour_of(_mask(40, 40))
    apart = points - [60, -60]
    assert np.linalg.norm(apart, axis=1) == pytest.approx(np.full(len(apart), 40), abs=0.8)
    assert (normals * apart).sum(1).min() > 0.95 * 40


@pytest.mark.parametrize(("azimuth", "axis"), [(0.0, 0), (90.0, 2), (180.0, 0)])
def test_a_ball_becomes_as_wide_as_an_ellipse_in_its_view(azimuth: float, axis: int) -> None:
    verts, faces = _ball()
    moved = outlined(verts, faces, [_outline(azimuth, 0, *_ellipse(0.45, 0.3))])
    extent = np.ptp(moved, axis=0)
    assert extent[axis] == pytest.approx(0.9, abs=0.02)
    assert extent[1] == pytest.approx(0.6, abs=0.02)


def test_two_views_give_all_three_extents() -> None:
    verts, faces = _ball()
    front = _outline(0, 0, *_ellipse(0.4, 0.3))
    side = _outline(90, 0, *_ellipse(0.2, 0.3))
    moved = outlined(verts, faces, [front, side])
    assert np.ptp(moved, axis=0) == pytest.approx([0.8, 0.6, 0.4], abs=0.02)


def test_its_own_outline_moves_nothing_to_speak_of() -> None:
    verts, faces = _ball()
    moved = outlined(verts, faces, [_outline(30, 20, *_ellipse(0.3, 0.3))])
    assert np.abs(moved - verts).max() < 0.015


def test_what_is_near_the_camera_is_seen_larger() -> None:
    outline = _outline(0, 0, *_ellipse(1, 1), distance=2.0)
    seen, larger = outline.seen_at(np.array([[0.1, 0.2, 1.0], [0.1, 0.2, 0.0]]))
    assert larger == pytest.approx([2, 1])
    assert seen == pytest.approx(np.array([[0.2, 0.4], [0.1, 0.2]]))


def test_masks_get_the_size_and_direction_of_the_surface() -> None:
    verts, faces = _ball()
    turn = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])  # +X of the file becomes the front, +Z
    outlines = outlines_of([SilhouetteView(_mask(40, 20), 90.0)], verts, faces, turn)
    assert outlines[0].right == pytest.approx([1, 0, 0], abs=1e-9)
    assert np.ptp(outlines[0].points, axis=0) == pytest.approx([2 * 0.38, 0.38], rel=0.05)
    moved = outlined(verts, faces, outlines)
    extent = np.ptp(moved, axis=0)
    assert extent[0] / extent[1] == pytest.approx(2, rel=0.06)


def test_an_outline_leads_beside_a_goal() -> None:
    verts, faces = _ball(3)
    ball, outlines = CodedSurface.alike(verts, faces), Outlines(verts, faces, [_outline(0, 0, *_ellipse(0.4, 0.3))])
    moved = smooth_fit(ball, ball, planes=(0,), pulls=[outlines])
    assert 0.66 < np.ptp(moved[:, 0]) < 0.82
    assert np.array_equal(moved, smooth_fit(ball, ball, planes=(0,), pulls=[outlines]))
