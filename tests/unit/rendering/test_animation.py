"""Animated pictures, read back."""

from __future__ import annotations

import dataclasses
import io
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageSequence

from meshdeform.geometry.appearance import Appearance, Paint
from meshdeform.geometry.shapes import icosphere
from meshdeform.rendering.studio import FORMATS, SurfaceState, morph_animation, turntable_animation
from tests.cases import each_case
from tests.fakes import plain_appearance


@pytest.fixture
def red_ball() -> tuple[Appearance, SurfaceState, SurfaceState]:
    ball = icosphere(2)
    look = plain_appearance(len(ball.verts), ball.faces)
    red = dataclasses.replace(look, paints=(Paint((1, 0, 0, 1)),))
    verts = ball.verts
    return red, SurfaceState(verts, verts), SurfaceState(verts * [1.0, 0.4, 1.0], verts)


def areas(data: bytes) -> tuple[list[int], list[int]]:
    """Return the red area and the duration of each frame."""
    image = Image.open(io.BytesIO(data))
    frames = [(np.asarray(f.convert("RGB")).astype(int), f.info["duration"]) for f in ImageSequence.Iterator(image)]
    assert image.info["loop"] == 0
    return [int((f[..., 0] - f[..., 1] > 60).sum()) for f, _ in frames], [time for _, time in frames]


@each_case("kind", FORMATS.values())
def test_a_morph_goes_to_the_result_and_back(red_ball: tuple[Any, ...], kind: str) -> None:
    data = morph_animation(*red_ball, kind=kind, size=64, frames=5)
    sizes, times = areas(data)
    assert Image.open(io.BytesIO(data)).format == kind
    assert len(sizes) == 8
    assert sizes[0] > sizes[2] > sizes[4] < sizes[6]
    assert sizes[4] / sizes[0] == pytest.approx(0.45, abs=0.1)
    assert sizes[3] == pytest.approx(sizes[5], rel=0.03)
    assert times[0] == times[4] == 800
    assert times[1] == 60


def test_a_turntable_shows_all_sides_at_one_size(red_ball: tuple[Any, ...]) -> None:
    appearance, ball, _ = red_ball
    sizes, _ = areas(turntable_animation(appearance, ball, kind="WEBP", size=64, frames=6))
    assert len(sizes) > 1 or len(set(sizes)) == 1
    assert max(sizes) - min(sizes) < 0.03 * max(sizes)
