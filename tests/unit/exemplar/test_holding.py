"""Vertices are kept to the bit, handles and bodies to a millionth; without constraints the fit is returned."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.deformation.settings import Rigidity
from meshdeform.exemplar.holding import held_displacement
from meshdeform.nouns.labels import Floats, Index


def sphere(count: int = 24) -> tuple[Floats, Index]:
    """A sphere of radius 1 of rings, without poles: open at both ends."""
    up, around = np.meshgrid(np.linspace(0.1, np.pi - 0.1, count), np.linspace(0, 2 * np.pi, count, endpoint=False))
    verts = np.stack([np.sin(up) * np.cos(around), np.cos(up), np.sin(up) * np.sin(around)], -1).reshape(-1, 3)
    grid = np.arange(count**2).reshape(count, count)
    a, b = grid[:, :-1].ravel(), np.roll(grid, -1, 0)[:, :-1].ravel()
    c, d = np.roll(grid, -1, 0)[:, 1:].ravel(), grid[:, 1:].ravel()
    return verts, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def fit_of(rest: Floats) -> Floats:
    return rest * [1.5, 0.7, 1.1] + 0.1 * np.sin(4 * rest[:, [1, 2, 0]]) + [0.3, 0.0, 0.2]


def weights(rest: Floats) -> Floats:
    free = np.clip((rest[:, 1] + 0.8) / 0.5, 0, 1)
    return np.asarray(free**2 * (3 - 2 * free))


def test_without_constraints_the_fit_is_returned() -> None:
    rest, faces = sphere()
    goal = fit_of(rest)
    held = held_displacement(rest, goal, faces, weight=np.ones(len(rest)))
    assert np.array_equal(held, goal)
    assert not np.shares_memory(held, goal)


def test_what_is_kept_has_the_bits_of_the_source_and_far_from_it_is_the_fit() -> None:
    rest, faces = sphere()
    goal, weight = fit_of(rest), weights(rest)
    held = held_displacement(rest, goal, faces, weight=weight)
    assert held[weight == 0].tobytes() == rest[weight == 0].tobytes()
    assert np.array_equal(held[weight == 1], goal[weight == 1])
    assert (weight == 0).any()


def test_handles_are_reached_and_what_is_far_is_not_moved_by_them() -> None:
    rest, faces = sphere()
    goal, weight = fit_of(rest), weights(rest)
    rows = np.array([int(rest[:, 1].argmax()), int(rest[:, 0].argmax())])
    places = goal[rows] + [[0.0, 0.4, 0.0], [0.2, 0.0, 0.0]]
    held = held_displacement(rest, goal, faces, weight=weight, handles=(rows, places))
    assert np.abs(held[rows] - places).max() < 1e-6
    assert held[weight == 0].tobytes() == rest[weight == 0].tobytes()
    near = np.linalg.norm(rest - rest[rows[0]], axis=1) < 0.2
    assert (held[near, 1] > goal[near, 1] + 0.15).all()
    one = held_displacement(rest, goal, faces, weight=np.ones(len(rest)), handles=(rows[:1], places[:1]))
    assert np.abs(one - goal)[rest[:, 1] < -0.9].max() < 0.1


@pytest.mark.parametrize("mode", Rigidity)
def test_bodies_keep_their_shape_and_their_surroundings_follow(mode: Rigidity) -> None:
    rest, faces = sphere()
    goal = fit_of(rest)
    body = np.flatnonzero(rest[:, 0] > 0.7)
    held = held_displacement(rest, goal, faces, weight=np.ones(len(rest)), bodies=[(body, mode)])
    before, after = (points[body] - points[body].mean(0) for points in (rest, held))
    scale = np.linalg.norm(after) / np.linalg.norm(before)
    u, _, v = np.linalg.svd(before.T @ after)
    assert np.linalg.det(u @ v) == pytest.approx(1)
    assert np.abs(scale * before @ u @ v - after).max() < 1e-6
    assert scale == pytest.approx(1, abs=1e-6) if mode is Rigidity.RIGID else abs(scale - 1) > 0.02
    lengths = [np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1) for points in (goal, held)]
    assert (lengths[1] < 2.5 * lengths[0]).all()
    assert np.abs(held - goal)[rest[:, 0] < -0.5].max() < 0.05


def test_a_body_that_is_kept_in_part_stays_and_its_handles_do_nothing() -> None:
    rest, faces = sphere()
    goal, weight = fit_of(rest), weights(rest)
    body = np.flatnonzero(rest[:, 0] > 0.3)
    assert (weight[body] == 0).any()
    handles = (body[:1], goal[body[:1]] + 1)
    held = held_displacement(rest, goal, faces, weight=weight, handles=handles, bodies=[(body, Rigidity.RIGID)])
    kept = np.union1d(body, np.flatnonzero(weight == 0))
    assert held[kept].tobytes() == rest[kept].tobytes()


def test_loose_parts_that_touch_follow() -> None:
    rest, faces = sphere()
    small = 0.1 * rest + 1.101 * rest[5]
    both, joined = np.concatenate([rest, small]), np.concatenate([faces, faces + len(rest)])
    handles = (np.array([5]), rest[[5]] + [0.0, 0.5, 0.0])
    held = held_displacement(both, both, joined, weight=np.ones(len(both)), handles=handles)
    assert (held - both)[len(rest) :, 1].mean() > 0.4


def test_a_body_on_a_line_and_everything_held() -> None:
    rest, faces = sphere()
    line = np.array([0, 1])
    everything = [(np.arange(len(rest)), Rigidity.RIGID)]
    held = held_displacement(rest, rest + 1, faces, weight=np.ones(len(rest)), bodies=[(line, Rigidity.RIGID)])
    assert np.abs(held - rest - 1).max() < 1e-9
    held = held_displacement(rest, fit_of(rest), faces, weight=np.ones(len(rest)), bodies=everything)
    before, after = rest - rest.mean(0), held - held.mean(0)
    assert np.abs(before @ before.T - after @ after.T).max() < 1e-9
