"""Strips and fans make the triangles that the glTF specification lists."""

from __future__ import annotations

import numpy as np

from meshdeform.assets.document import triangle_list


def triangles(corners: list[int], mode: int, restart: int | None = None) -> list[list[int]]:
    return triangle_list(np.array(corners, np.int64), mode, restart).tolist()


def test_a_list_keeps_its_degenerate_triangles_and_drops_what_is_left_over() -> None:
    assert triangles([0, 1, 2, 2, 2, 3, 9], 4) == [[0, 1, 2], [2, 2, 3]]


def test_every_second_triangle_of_a_strip_is_turned() -> None:
    assert triangles([0, 1, 2, 3, 4], 5) == [[0, 1, 2], [1, 3, 2], [2, 3, 4]]


def test_a_strip_stitched_by_repeated_corners_keeps_its_winding() -> None:
    assert triangles([0, 1, 2, 3, 3, 4, 4, 5, 6], 5) == [[0, 1, 2], [1, 3, 2], [4, 5, 6]]


def test_a_fan_turns_around_its_first_corner() -> None:
    assert triangles([0, 1, 2, 3], 6) == [[1, 2, 0], [2, 3, 0]]


def test_restarts_begin_a_new_strip_and_a_new_fan() -> None:
    assert triangles([0, 1, 2, 255, 3, 4, 5, 6, 255, 7], 5, 255) == [[0, 1, 2], [3, 4, 5], [4, 6, 5]]
    assert triangles([0, 1, 2, 255, 3, 4, 5], 6, 255) == [[1, 2, 0], [4, 5, 3]]


def test_too_few_corners_make_no_triangle() -> None:
    for mode in (4, 5, 6):
        assert triangles([0, 1], mode) == []
        assert triangles([], mode) == []
