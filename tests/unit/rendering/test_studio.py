"""Photographs: how large the asset is in them, what is behind it, and its shadow."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from meshdeform.geometry.appearance import Paint
from meshdeform.geometry.shapes import icosphere
from meshdeform.rendering.studio import Studio, SurfaceState
from tests.fakes import plain_appearance

BALL = icosphere(3)
RED = dataclasses.replace(plain_appearance(len(BALL.verts), BALL.faces), paints=(Paint((1.0, 0.0, 0.0, 1.0)),))
SIZE = 80


def photographed(verts: np.ndarray, *, plain: bool = False) -> np.ndarray:
    pose = SurfaceState(verts, BALL.verts)
    picture = Studio(RED, (pose,), size=SIZE, azimuths_deg=(0.0,), plain=plain).photograph(pose, (0.0,))
    return picture[0].astype(int)


def test_an_asset_fills_the_view_whatever_its_size_and_place() -> None:
    pictures = [photographed(scale * BALL.verts + shift) for scale, shift in ((1.0, 0.0), (1e-3, 5.0), (1e4, -2e5))]
    red = pictures[0][..., 0] - pictures[0][..., 1] > 60
    rows, columns = np.flatnonzero(red.any(1)), np.flatnonzero(red.any(0))
    assert np.ptp(rows) == pytest.approx(0.9 * SIZE, abs=2)
    assert rows.mean() == pytest.approx(columns.mean(), abs=1) == pytest.approx((SIZE - 1) / 2, abs=1)
    for other in pictures[1:]:
        assert np.abs(other - pictures[0]).max() <= 2


def test_the_ground_is_dark_below_what_stands_on_it_and_the_background_light() -> None:
    disc = photographed(BALL.verts * [1.0, 0.2, 1.0])
    below, beside = disc[55, SIZE // 2], disc[55, 1]
    assert (below < beside - 15).all()
    assert np.ptp(below) < 10  # the shadow is grey
    assert disc[0].min() > disc[-1, 1].max()
    assert (photographed(BALL.verts * [1.0, 0.2, 1.0], plain=True)[55, SIZE // 2] == (240, 241, 242)).all()
