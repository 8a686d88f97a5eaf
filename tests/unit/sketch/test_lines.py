"""Visible lines of a mesh: silhouettes and creases, without what is hidden."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.sketch.lines import View, joined, visible_lines
from meshdeform.sketch.solids import Solid, box, lathe


def length(lines: list[np.ndarray]) -> float:
    return sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)


def test_nine_of_twelve_edges_of_a_cube_are_seen_from_a_corner_and_four_from_the_front() -> None:
    cube = joined({"cube": box((-1, -1, -1), (1, 1, 1))})
    # From far away at azimuth 45, edges of length 2 have these lengths on a page whose half size is sqrt(3).
    e = np.radians(35.2643896828)
    flat, upright = np.sqrt(2 + 2 * np.sin(e) ** 2), 2 * np.cos(e)
    expected = (6 * flat + 3 * upright) / (2 * np.sqrt(3))
    assert length(visible_lines(cube, View(45, 35.2643896828, 1.0))) == pytest.approx(expected, rel=0.02)
    assert length(visible_lines(cube, View(0, 0, 1.0))) == pytest.approx(8 / (2 * np.sqrt(3)), rel=0.02)


def test_a_cube_behind_a_wall_is_not_seen() -> None:
    wall = box((-2, -2, 2), (2, 2, 2.1))
    alone = visible_lines(joined({"wall": wall}), View(0, 0, 1.0))
    behind = joined({"wall": wall, "cube": box((-0.5, -0.5, 0), (0.5, 0.5, 1))})
    ratio = length(visible_lines(behind, View(0, 0, 1.0))) / length(alone)
    radii = [np.linalg.norm([2, 2, half]) for half in (0.05, 1.05)]  # each picture is fitted to its own sphere
    assert ratio == pytest.approx(radii[0] / radii[1], rel=0.02)


def test_a_smooth_body_has_only_its_outline() -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 25)
    profile = np.stack([np.cos(angle), np.sin(angle)], 1)
    profile[[0, -1], 0] = 0
    ball = joined({"ball": lathe(profile.tolist(), 48)})
    assert isinstance(ball, Solid)
    lines = visible_lines(ball, View(20, 10, 1.0))
    distances = np.linalg.norm(np.concatenate(lines) - 0.5, axis=1)
    assert distances.min() > 0.45
    # Where the outline jumps between rings, a few of its edges lie behind the ball.
    assert length(lines) == pytest.approx(np.pi, rel=0.1)
