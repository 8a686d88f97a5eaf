"""Along axes what is level stays level; outlines become those of the goal; wheels stay round on the ground."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.exemplar.axis_maps import axis_maps
from meshdeform.exemplar.fitting import SourceFit
from meshdeform.exemplar.pieces import pieces_of
from meshdeform.exemplar.profiles import outlined
from meshdeform.exemplar.shapes import Shape
from meshdeform.nouns.families.parts import ellipsoid
from meshdeform.nouns.labels import labelled_member
from meshdeform.reading.samples import spread


def shape_of(noun: str, seed: int = 1) -> Shape:
    """Return a member in the frame of fits."""
    member = labelled_member(noun, (), np.random.default_rng(seed))
    low, high = member.verts.min(0), member.verts.max(0)
    verts = (member.verts - (low + high) / 2) / np.linalg.norm(high - low)
    return Shape(noun, verts, member.faces, member.labels, member.solid_of_face)


def test_axis_maps_find_piecewise_scales_and_rise() -> None:
    places = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
    goals = np.where(places > 0, 2 * places, 0.5 * places) * [1, 1, -1]
    maps = axis_maps(places, goals, np.ones(len(places)), mirrored=False)
    moved = maps.map_points(places)
    assert np.abs(moved - goals)[:, :2].mean() < 0.03
    rising = maps.along(2, np.linspace(-1.5, 1.5, 50))
    assert (np.diff(rising) > 0).all()


def test_a_mirrored_axis_map_is_odd() -> None:
    places = np.random.default_rng(1).uniform(-1, 1, (500, 3))
    maps = axis_maps(places, places + [0.1, 0, 0], np.ones(len(places)), mirrored=True)
    at = np.linspace(-1, 1, 9)
    np.testing.assert_allclose(maps.along(0, at), -maps.along(0, -at), atol=1e-9)


def test_a_ball_takes_the_outline_of_a_spindle() -> None:
    ball = ellipsoid([0, 0, 0], 0.5, rings=40)
    spindle = ball.verts * [0.5, 1, 0.8] * (1 + 0.3 * np.cos(6 * ball.verts[:, 1:2])) ** [1, 0, 1]
    places, goals = spread(ball.verts, ball.faces, 6000, 0).positions, spread(spindle, ball.faces, 6000, 0).positions
    moved = outlined(ball.verts, places, goals, lambda y: y, 0.02)
    inner = np.abs(ball.verts[:, 1]) < 0.4
    assert np.abs(moved - spindle)[inner].max() < 0.03
    np.testing.assert_allclose(moved[:, 1], ball.verts[:, 1])


def test_wheels_of_a_car_stay_round_on_the_ground() -> None:
    car, truck = shape_of("car"), shape_of("truck", 2)
    fitted = SourceFit(car).fit(truck)
    pieces = pieces_of(car, {"wheel": "wheel"})
    ground = fitted.ways["axes"][:, 1].min()
    for piece in range(len(pieces)):
        rows = np.unique(car.faces[pieces.of_face == piece])
        size, before = np.ptp(fitted.ways["axes"][rows], axis=0), np.ptp(car.verts[rows], axis=0)
        np.testing.assert_allclose(size[1] / before[1], size[2] / before[2], rtol=1e-3)
        assert fitted.ways["axes"][rows, 1].min() < ground + 0.01


def test_level_faces_of_what_is_built_stay_level() -> None:
    chair, table = shape_of("chair"), shape_of("table")
    fitted = SourceFit(chair).fit(table)
    level = np.ptp(chair.verts[chair.faces][..., 1], axis=1) < 1e-6
    assert level.sum() > 10
    assert np.ptp(fitted.ways["axes"][chair.faces[level]][..., 1], axis=1).max() < 1e-6


def test_a_bottle_becomes_a_rocket_as_a_whole() -> None:
    bottle, rocket = shape_of("bottle"), shape_of("rocket")
    ways = SourceFit(bottle).fit(rocket).ways
    assert next(iter(ways)) == "whole"
    goal = cKDTree(spread(rocket.verts, rocket.faces, 6000, 0).positions)
    away = {name: goal.query(verts)[0].mean() for name, verts in ways.items()}
    assert min(away, key=away.__getitem__) == "whole"
