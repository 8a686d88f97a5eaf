"""Cameras: conventions by hand, and draws within their bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from meshdeform.rendering.cameras import CameraRange, Cameras, Framing, fixed_cameras
from meshdeform.rendering.views import combine_views, sample_orthogonal_cameras
from tests.cases import each_case


def project(cameras: Cameras, point: tuple[float, float, float], view: int = 0) -> NDArray[np.float32]:
    clip = cameras.project(np.array([point], np.float32))[view, 0]
    return clip[:3] / clip[3]


def test_azimuth_0_stands_on_plus_z_and_the_four_views_are_quarter_turns() -> None:
    cameras = fixed_cameras(0.0, 0.0)
    assert cameras.eye[0, 2] > 1
    np.testing.assert_allclose(cameras.eye[0, :2], 0, atol=1e-6)
    assert project(cameras, (0.5, 0, 0))[0] > 0.1
    assert project(cameras, (0, 0.5, 0))[1] > 0.1
    cameras = fixed_cameras(90.0, 0.0)
    assert cameras.eye[0, 0] > 1
    assert project(cameras, (0, 0, -0.5))[0] > 0.1
    cameras = fixed_cameras(0.0, 0.0)
    assert project(cameras, (0, 0, 0.5))[2] < project(cameras, (0, 0, -0.5))[2]
    cameras = fixed_cameras(20.0, 10.0)
    turned = fixed_cameras(110.0, 10.0)
    np.testing.assert_allclose(cameras.view_proj[1], turned.view_proj[0], atol=1e-5, rtol=1e-5)
    np.testing.assert_allclose(cameras.view_proj[3], turned.view_proj[2], atol=1e-5, rtol=1e-5)
    rotation = fixed_cameras(57.0, 28.0).view[:, :3, :3]
    np.testing.assert_allclose(rotation @ rotation.mT, np.tile(np.eye(3), (4, 1, 1)), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(rotation), 1, atol=1e-5)
    eye = fixed_cameras(0.0, 30.0).eye[0]
    assert math.isclose(eye[1] / np.linalg.norm(eye), 0.5, rel_tol=1e-5)
    cameras = fixed_cameras(-30.0, 10.0)
    assert cameras.azimuths_deg == (-30.0, 60.0, 150.0, 240.0)
    assert cameras.azimuth_deg == -30.0


@each_case("fov", [10.0, 30.0, 45.0, 100.0])
def test_the_unit_sphere_just_fits(fov: float) -> None:
    cameras = fixed_cameras(33.0, 17.0, fov)
    points = np.random.default_rng(0).normal(size=(5000, 3)).astype(np.float32)
    clip = cameras.project(points / np.linalg.norm(points, axis=1, keepdims=True))[0]
    assert 0.85 < np.abs(clip[:, :2] / clip[:, 3:]).max() < 1.0
    assert np.abs(clip[:, 2] / clip[:, 3]).max() < 1


def test_a_framed_sphere_reaches_its_share_and_is_followed() -> None:
    framing = Framing(share=0.5, largest=0.8)
    for now, share in (
        (0.3, 0.5),
        (0.2, 0.5 * 0.2 / 0.3),
        (0.4, 0.5 * 0.4 / 0.3),
        (0.48, 0.8),
        (3.0, 0.8),
        (0.01, 0.5 / 1.6),
    ):
        radius = framing.fitting_radius(0.3, now)
        assert now / radius == pytest.approx(share), now
        cameras = fixed_cameras(0.0, 0.0, 40.0, fitting_radius=radius)
        # The tangent from the eye to the sphere meets the view's border where its sine is the half angle's.
        distance = float(np.linalg.norm(cameras.eye[0]))
        assert now / distance == pytest.approx(share * math.sin(math.radians(20.0)), rel=1e-5)
    follows = Framing(share=0.9, largest=0.9)
    assert follows.fitting_radius(0.3, 0.1) == pytest.approx(0.1 / 0.9)
    assert follows.fitting_radius(0.3, 2.0) == pytest.approx(2.0 / 0.9)


@each_case("radius", [0.1, 1.05, 40.0])
def test_a_bias_in_depth_means_a_similar_length_at_every_field_of_view(radius: float) -> None:
    """The antialiasing compares depths with a constant: it must not tell other silhouettes apart at 45 than at 30."""
    lengths = []
    for fov in (30.0, 37.5, 45.0):
        cameras = fixed_cameras(0.0, 0.0, fov, fitting_radius=radius)
        clip = cameras.project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1e-2 * radius]], np.float32))[0]
        z = clip[:, 2] / clip[:, 3]
        lengths.append(1e-2 * 1e-4 / float(z[1] - z[0]))  # of a radius, for a bias of 1e-4
    assert max(lengths) < 2 * min(lengths)
    assert max(lengths) < 1e-3


def test_draws_stay_in_bounds_and_follow_the_seed() -> None:
    bounds = CameraRange(5.0, 25.0, 31.0, 44.0)
    generator = torch.Generator().manual_seed(4)
    seen = [sample_orthogonal_cameras(bounds, generator) for _ in range(200)]
    assert all(-180 <= c.azimuth_deg <= 180 and 31 <= c.fov_deg <= 44 for c in seen)
    assert all(5 <= e <= 25 for c in seen for e in c.elevation_deg)
    assert max(c.azimuth_deg for c in seen) > 150
    assert min(c.azimuth_deg for c in seen) < -150
    assert len(set(seen[0].elevation_deg)) == 4
    again = sample_orthogonal_cameras(bounds, torch.Generator().manual_seed(4))
    assert again.azimuth_deg == seen[0].azimuth_deg
    np.testing.assert_array_equal(again.view_proj, seen[0].view_proj)


# The arrangement of views: which cameras, which picture.


def test_four_views_a_quarter_turn_apart_fill_one_picture() -> None:
    cameras = sample_orthogonal_cameras(CameraRange(), torch.Generator().manual_seed(0), 1.05)
    turns = [(b - a) % 360 for a, b in zip(cameras.azimuths_deg, cameras.azimuths_deg[1:], strict=False)]
    assert turns == pytest.approx([90.0] * 3)
    images = torch.arange(4.0).view(4, 1, 1, 1).expand(4, 24, 24, 3)
    picture = combine_views(images)
    assert picture.shape == (1, 3, 48, 48)
    assert picture[0, 0, ::47, ::47].tolist() == [[0, 1], [2, 3]]
