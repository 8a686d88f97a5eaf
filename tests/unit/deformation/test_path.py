"""Shapes between rest and result: exact at both ends, and what bends keeps its length and volume on the way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.deformation.path import ShapePath
from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from tests.close import assert_close
from tests.unit.deformation.worlds import moved
from training.shapes import box, cylinder

LENGTH = 4.0
BAR = cylinder(0.25, LENGTH, 16, 32)
SHARES = [0.25, 0.5, 0.75]


def train() -> TriangleMesh:
    """Ten separate boxes in a row, with gaps between them."""
    return join(*[moved(box(2, (0.4, 0.28, 0.4)), 0.0, 0.4 * k - 1.8, 0.0) for k in range(10)])


def bend(verts: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Bend along Y about an axis parallel to Z; the lower end stays in place."""
    radius = LENGTH / math.radians(degrees)
    angle, arm = (verts[:, 1] + LENGTH / 2) / radius, radius - verts[:, 0]
    return np.stack([radius - arm * np.cos(angle), arm * np.sin(angle) - LENGTH / 2, verts[:, 2]], 1)


def turned(verts: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Turn about Y."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return verts @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]], np.float64)


def volume(mesh: TriangleMesh, verts: NDArray[np.float64]) -> float:
    a, b, c = verts[mesh.faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


@each_case("mesh", [BAR, train()])
def test_the_ends_are_exact(mesh: TriangleMesh) -> None:
    result = bend(mesh.verts, 120) + 0.01 * np.sin(mesh.verts)
    path = ShapePath(mesh, result)
    assert np.array_equal(path.at(0), mesh.verts)
    assert np.array_equal(path.at(1), result)
    # Nothing jumps just before an end.
    assert_close(path.at(1e-9), mesh.verts, atol=1e-7, rtol=0)
    assert_close(path.at(1 - 1e-9), result, atol=1e-7, rtol=0)
    with pytest.raises(ShapeError, match="expected verts"):
        ShapePath(mesh, result[1:])


@each_case("share", SHARES)
def test_a_bend_of_120_degrees_keeps_lengths_and_volume_and_parts_together(share: float) -> None:
    for mesh in (BAR, train()):
        shape = ShapePath(mesh, bend(mesh.verts, 120)).at(share)
        # A bend by that share of the angle, up to 0.3 % of the length.
        assert_close(shape, bend(mesh.verts, 120 * share), atol=0.003 * LENGTH, rtol=0)
        assert abs(volume(mesh, shape) / volume(mesh, mesh.verts) - 1) < 0.002
        assert measure(mesh.verts, mesh.faces, shape).flipped_faces == 0


@each_case("degrees", [179.9, 180.0, 180.1])
def test_a_half_turn_is_a_turn_of_all_faces_in_one_direction(degrees: float) -> None:
    # Jittered, so that some faces turn by slightly less than pi and others by slightly more.
    mesh = join(icosphere(2), moved(icosphere(2), 3.0, 0.0, 0.0))
    noise = 0.01 * np.random.default_rng(0).normal(size=mesh.verts.shape)
    half = ShapePath(mesh, turned(mesh.verts, degrees) + noise).at(0.5)
    assert abs(volume(mesh, half) / volume(mesh, mesh.verts) - 1) < 0.02
    centres = half[: len(half) // 2].mean(0), half[len(half) // 2 :].mean(0)
    assert float(np.linalg.norm(centres[1] - centres[0])) == pytest.approx(3.0, abs=0.02)


def test_beyond_the_result_it_goes_on_and_what_shrinks_never_collapses() -> None:
    shape = ShapePath(BAR, bend(BAR.verts, 80)).at(1.5)
    assert_close(shape, bend(BAR.verts, 120), atol=0.005 * LENGTH, rtol=0)
    thin = ShapePath(BAR, BAR.verts * np.array([0.2, 2.0, 0.2], np.float64)).at(1.5)
    assert float(thin[:, 0].max() / BAR.verts[:, 0].max()) == pytest.approx(0.2**1.5, rel=0.01)
    assert float(np.ptp(thin[:, 1])) == pytest.approx(2.5 * LENGTH, rel=1e-6)


def test_what_both_ends_have_in_the_same_place_stays() -> None:
    still = BAR.verts[:, 1] < -1.0
    result = np.where(still[:, None], BAR.verts, BAR.verts + (BAR.verts[:, 1:2] + 1.0) ** 2)
    half = ShapePath(BAR, result).at(0.5)
    assert float(np.abs((half - BAR.verts)[BAR.verts[:, 1] < -1.5]).max()) < 0.005 * LENGTH


def test_collapsed_faces_and_flat_results() -> None:
    # A box with a face without area, flattened to a sheet: its faces have no rotation of their own.
    verts = np.concatenate([box(2).verts, box(2).verts[:2].mean(0, keepdims=True)])
    mesh = TriangleMesh(verts, np.concatenate([box(2).faces, np.array([[0, 1, len(verts) - 1]])]))
    flat = verts * np.array([1.0, 0.0, 1.0])
    half = ShapePath(mesh, flat).at(0.5)
    assert_close(half, (verts + flat) / 2, atol=1e-6, rtol=0)
