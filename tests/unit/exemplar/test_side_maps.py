"""Seen from the side a vehicle takes the outline of another one; wheels stay round, and unlike ones are left alone."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.side_maps import by_side
from meshdeform.nouns.families.parts import ellipsoid
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.result import NO_PART
from meshdeform.reading.samples import spread


def grid_box(heights: Floats, length: float, width: float, rows: int = 8) -> tuple[Floats, Index]:
    """Return the vertices and faces of a body over heights (N,) along its length, from -Z to +Z, its ends closed."""
    along = np.linspace(-length / 2, length / 2, len(heights))
    up = np.linspace(0, 1, rows + 1)
    flat = np.stack([np.repeat(along, rows + 1), (heights[:, None] * up[None]).ravel()], 1)
    verts = np.concatenate([np.column_stack([np.full(len(flat), x), flat[:, 1], flat[:, 0]]) for x in (-width, width)])
    cells = (np.arange(len(heights) - 1)[:, None] * (rows + 1) + np.arange(rows)[None]).ravel()
    quads = np.stack([cells, cells + 1, cells + rows + 2, cells + rows + 1], 1)
    count = len(flat)
    top, bottom = np.arange(len(heights)) * (rows + 1) + rows, np.arange(len(heights)) * (rows + 1)
    rim = np.concatenate([bottom, top[-1:] - rows + np.arange(1, rows + 1), top[::-1][1:], np.arange(rows)[::-1][:-1]])
    ends = np.stack([rim, np.roll(rim, -1), np.roll(rim, -1) + count, rim + count], 1)
    every = np.concatenate([quads, quads[:, ::-1] + count, ends[:, ::-1]])
    return verts, np.concatenate([every[:, [0, 1, 2]], every[:, [0, 2, 3]]])


def vehicle(heights: Floats, length: float, width: float, radius: float = 0.12) -> tuple[Shape, list[Index]]:
    """Return a body with four wheels under it, and the faces of each."""
    verts, faces = grid_box(heights, length, width)
    parts, start, wheels = [(verts, faces)], len(faces), []
    for x, z in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        ball = ellipsoid([width * x, 0, 0.35 * length * z], radius, rings=10)
        parts.append((ball.verts * [1, 1, 1], ball.faces))
        wheels.append(np.arange(start, start + len(ball.faces)))
        start += len(ball.faces)
    counts = np.cumsum([0, *(len(each) for each, _ in parts)])
    every = np.concatenate([each + first for (_, each), first in zip(parts, counts, strict=False)])
    places = np.concatenate([each for each, _ in parts])
    return Shape("car", places, every, np.full(len(every), NO_PART)), wheels


VAN = np.where(np.arange(41) < 28, 0.5, 0.28)
BUS = np.full(41, 0.55)


def test_an_equal_goal_moves_nothing() -> None:
    own, wheels = vehicle(VAN, 1.2, 0.2)
    moved = by_side(own, own, wheels, wheels)
    assert moved is not None
    assert np.abs(moved - own.verts).max() < 0.01


def test_a_bonnet_goes_up_into_the_box_of_a_bus() -> None:
    (own, wheels), (goal, others) = vehicle(VAN, 1.2, 0.2), vehicle(BUS, 1.4, 0.25)
    moved = by_side(own, goal, wheels, others)
    assert moved is not None
    body = np.delete(own.faces, np.concatenate(wheels), 0)
    places = spread(moved, body, 6000, 0).positions
    front = places[places[:, 2] > 0.45]
    assert front[:, 1].max() > 0.45
    assert own.verts[own.verts[:, 2] > 0.35][:, 1].max() < 0.3
    assert np.ptp(places[:, 0]) == pytest.approx(0.5, rel=0.1)
    assert np.ptp(places[:, 2]) == pytest.approx(1.4, rel=0.03)


def test_wheels_stay_round_and_on_the_ground() -> None:
    (own, wheels), (goal, others) = vehicle(VAN, 1.2, 0.2), vehicle(BUS, 1.4, 0.25, 0.14)
    moved = by_side(own, goal, wheels, others)
    assert moved is not None
    for faces, other in zip(wheels, others, strict=True):
        now, there = moved[np.unique(own.faces[faces])], goal.verts[np.unique(goal.faces[other])]
        size = np.ptp(now, axis=0)
        assert size[1] == pytest.approx(size[2], rel=1e-6)
        assert now[:, 1].min() == pytest.approx(goal.verts[:, 1].min(), abs=1e-6)
        np.testing.assert_allclose(now[:, 2].mean(), there[:, 2].mean(), atol=1e-6)


def test_bodies_that_are_too_unlike_are_left() -> None:
    own, wheels = vehicle(VAN, 1.2, 0.2)
    tall = np.where(np.abs(np.arange(41) - 20) < 8, 1.4, 0.2)
    goal, others = vehicle(tall, 1.2, 0.2)
    assert by_side(own, goal, wheels, others) is None
