"""Polygons are cut into triangles inside their outlines that face as they do; convex ones keep their fan."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from meshdeform.assets.polygons import Triangulation, cut_polygons
from meshdeform.errors import AssetTooLargeError
from tests.cases import each_case

Points = NDArray[np.float64]

DART = [(0.0, 0.0), (1.0, 0.2), (0.0, 1.0), (0.2, 0.2)]
COMB = [(0.0, 0.0), (8.0, 0.0), *[(8.0 - i, 1.0 + 3.0 * (i % 2)) for i in range(9)]]
# A square with a square hole, whose outline runs to the hole and back over the same two corners.
FRAME = [(0, 0), (9, 0), (9, 9), (0, 9), (0, 0), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3)]


def area_vectors(corners: Points) -> Points:
    """Return the area vectors (T, 3) of triangles (T, 3, 3)."""
    return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def fan(polygon: Points) -> Points:
    return np.stack([np.broadcast_to(polygon[0], (len(polygon) - 2, 3)), polygon[1:-1], polygon[2:]], axis=1)


def check_cut(polygons: list[Points]) -> Triangulation:
    """Check that the triangles of each polygon face as it does and have its area between them."""
    points, sizes = np.concatenate(polygons), np.array([len(polygon) for polygon in polygons])
    cut = cut_polygons(points, sizes)
    assert np.bincount(cut.polygons).tolist() == (sizes - 2).tolist()
    starts = np.cumsum(sizes) - sizes
    for number, polygon in enumerate(polygons):
        corners = cut.triangles[cut.polygons == number]
        assert (corners.min(), corners.max()) == (starts[number], starts[number] + len(polygon) - 1)
        areas, whole = area_vectors(points[corners]), area_vectors(fan(polygon)).sum(axis=0)
        size = np.linalg.norm(whole)
        assert (areas @ whole >= -1e-9 * size**2).all(), "a triangle faces against its polygon"
        np.testing.assert_allclose(np.linalg.norm(areas, axis=1).sum(), size, rtol=1e-9)
    return cut


def placed(outline: Points | list[tuple[float, float]], turn: int = 0) -> Points:
    """Return an outline (N, 2) in a plane of space that is parallel to no axis; it begins at another corner."""
    axes = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0]]) / 3.0
    return np.roll(np.asarray(outline, float), turn, axis=0) @ axes * 0.01 + [40.0, -7.0, 3.0]


@each_case(("outline", "clipped"), [(DART, 2), (COMB, 11), (FRAME, 10)], ids=["dart", "comb", "frame"])
def test_a_concave_outline_is_filled_from_each_first_corner(outline: list[tuple[float, float]], clipped: int) -> None:
    polygons = [placed(outline, turn) for turn in range(len(outline))]
    assert check_cut(polygons).clipped == clipped
    assert check_cut([polygon[::-1] for polygon in polygons]).clipped == clipped


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(3, 24), min_size=1, max_size=5), st.integers(0, 2**32 - 1), st.booleans())
def test_star_shaped_polygons_are_filled(sizes: list[int], seed: int, middles: bool) -> None:
    generator = np.random.default_rng(seed)
    polygons = []
    for size in sizes:
        angles = (np.arange(size) + generator.uniform(0, 0.9, size)) / size * 2 * np.pi
        outline = np.stack([np.cos(angles), np.sin(angles)], axis=1) * generator.uniform(0.1, 1, (size, 1))
        if middles:  # corners on a straight side
            outline = np.stack([outline, (outline + np.roll(outline, -1, axis=0)) / 2], axis=1).reshape(-1, 2)
        polygons.append(placed(outline))
    check_cut(polygons)


def test_a_warped_quad_is_cut_where_both_halves_face_as_it_does() -> None:
    dart = np.column_stack([DART, [0.0, 0.1, 0.0, 0.1]])
    points = np.concatenate([dart, np.roll(dart, 1, axis=0)])
    halves = points[cut_polygons(points, np.array([4, 4])).triangles]
    assert (area_vectors(halves) @ area_vectors(fan(dart)).sum(axis=0) > 0).all()


def test_convex_polygons_keep_their_fan() -> None:
    angles = np.arange(6) / 6 * 2 * np.pi
    hexagon = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    cut = check_cut([placed(hexagon), placed([(0, 0), (1, 0), (1, 1), (0, 1)]), placed([(0, 0), (1, 0), (0, 1)])])
    wanted = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [6, 7, 8], [8, 9, 6], [10, 11, 12]]
    assert (cut.triangles.tolist(), cut.clipped) == (wanted, 0)


@each_case(
    "outline",
    [
        [(0, 0), (1, 1), (1, 0), (0, 1)],
        [(0, 0), (1, 0), (2, 0), (3, 0)],
        [(1, 1)] * 5,
        [(0, 0), (4, 0), (1, 3), (3, 3), (0, 1), (4, 2)],
    ],
    ids=["crossing", "on a line", "a point", "crossing itself"],
)
def test_an_outline_without_an_inside_gives_as_many_triangles(outline: list[tuple[float, float]]) -> None:
    cut = cut_polygons(placed(outline), np.array([len(outline)]))
    assert cut.triangles.shape == (len(outline) - 2, 3)
    assert set(cut.triangles.ravel().tolist()) == set(range(len(outline)))
    assert cut.clipped == 0


def test_the_largest_and_the_smallest_coordinates_are_cut() -> None:
    for scale in (1e38, 1e-38):
        cut = cut_polygons(np.column_stack([DART, np.zeros(4)]) * scale, np.array([4]))
        assert sorted(map(sorted, cut.triangles.tolist())) == [[0, 1, 3], [1, 2, 3]]


def test_a_polygon_that_would_take_minutes_is_refused() -> None:
    zigzag = np.random.default_rng(0).random((20_000, 3))
    with pytest.raises(AssetTooLargeError, match="20,000 corners"):
        cut_polygons(zigzag, np.array([20_000]))
