"""Seams are closed, details survive, and every source vertex finds its way back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from meshdeform.errors import AssetEmptyError
from meshdeform.geometry.coincidence import WELD_TOLERANCE
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.weld import weld
from tests.cases import each_case
from training.shapes import box


def split(mesh_verts: NDArray[np.float64], faces: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The same surface with three vertices of its own for every face, as flat shading exports it."""
    return mesh_verts[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


@each_case("mesh", [icosphere(2), box(3), join(icosphere(1), box(2))])
def test_a_split_mesh_is_welded_to_what_it_was(mesh) -> None:  # type: ignore[no-untyped-def]
    positions, triangles = split(mesh.verts, mesh.faces)
    welded = weld(positions, triangles)
    assert welded.mesh.verts.shape == mesh.verts.shape
    assert bool((edges_of(welded.mesh.faces).counts == 2).all())
    assert np.array_equal(welded.mesh.verts[welded.mesh.faces], mesh.verts[mesh.faces])
    assert np.array_equal(welded.face_source, np.arange(len(triangles)))
    assert np.array_equal(welded.mesh.verts[welded.vertex_map], positions)
    assert set(welded.skipped.values()) == {0}
    assert np.array_equal(welded.scatter(welded.mesh.verts, positions), positions)


def test_vertices_a_rounding_error_apart_are_one_and_keep_their_offset() -> None:
    mesh = icosphere(2)
    positions, triangles = split(mesh.verts, mesh.faces)
    noise = np.random.default_rng(0).uniform(-1, 1, positions.shape) * 0.2 * WELD_TOLERANCE
    welded = weld(positions + noise, triangles)
    assert welded.mesh.verts.shape == mesh.verts.shape
    out = welded.scatter(welded.mesh.verts + 1.0, positions + noise)
    np.testing.assert_allclose(out, positions + noise + 1.0, atol=1e-15, rtol=0)


def test_what_is_not_part_of_the_surface_is_skipped_and_counted() -> None:
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0.5, 0, 0]], float)
    welded = weld(positions, np.array([[0, 1, 3], [0, 1, 2], [0, 1, 4], [2, 2, 1]]))
    assert welded.face_source.tolist() == [1, 2]
    assert welded.skipped == {
        "unreferenced_vertices": 0,
        "degenerate_faces": 2,
        "zero_area_faces": 1,
        "non_manifold_edges": 0,
        "border_edges": 4,
    }
    assert welded.vertex_map[3] == welded.vertex_map[1]
    # Vertices that no face uses keep their place; negative zero is zero.
    positions = np.array([[0, 0, 0], [9, 9, 9], [1, 0, 0], [0, 1, 0], [0, 0, 0], [-0.0, 0, -0.0]], float)
    welded = weld(positions, np.array([[0, 2, 3], [5, 3, 2]]))
    assert welded.vertex_map.tolist() == [0, -1, 1, 2, -1, 0]
    assert welded.skipped["unreferenced_vertices"] == 2
    out = welded.scatter(welded.mesh.verts + 5, positions)
    assert out[[0, 1, 4]].tolist() == [[5, 5, 5], [9, 9, 9], [0, 0, 0]]


def test_a_chain_of_near_vertices_does_not_become_one_point() -> None:
    """A ribbon finer than the tolerance inside a large scene is thinned out, not swallowed whole."""
    n = 400
    x = np.arange(n) * 0.6 * WELD_TOLERANCE
    ribbon = np.stack([np.stack([x, 0 * x, 0 * x], 1), np.stack([x, 0 * x + 0.5, 0 * x], 1)], 1).reshape(-1, 3)
    i = 2 * np.arange(n - 1)
    triangles = np.concatenate([np.stack([i, i + 2, i + 1], 1), np.stack([i + 1, i + 2, i + 3], 1)])
    scale = np.array([[0.0, 0, 0], [0.5, 0.5, 0.7]])
    welded = weld(np.concatenate([ribbon, scale]), np.concatenate([triangles, [[0, 1, 2 * n + 1]]]))
    kept = welded.mesh.verts[welded.vertex_map[: 2 * n]][::2, 0]
    np.testing.assert_allclose(kept, ribbon[::2, 0], atol=1.5 * WELD_TOLERANCE)
    assert welded.mesh.verts.shape[0] > n // 2


def test_everything_at_one_place_is_quick_and_an_error_with_advice() -> None:
    rng = np.random.default_rng(1)
    positions = np.concatenate([rng.uniform(0, 1e-9, (20_000, 3)), [[1.0, 1, 1]]])
    triangles = rng.integers(0, 20_000, (20_000, 3))
    triangles[0, 0] = 20_000
    with pytest.raises(AssetEmptyError) as caught:
        weld(positions, triangles)
    assert caught.value.advice_text
    with pytest.raises(AssetEmptyError):
        weld(np.zeros((3, 3)), np.zeros((0, 3), np.int64))


coordinate = st.sampled_from([0.0, -0.0, 1.0, 0.5, 1e-7, 3e-7, 1 + 1e-7, -2.0])


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=12),
    st.lists(st.tuples(*[st.integers(0, 100)] * 3), min_size=1, max_size=16),
)
def test_any_soup_welds_or_says_that_it_is_empty(
    rows: list[tuple[float, float, float]], faces: list[tuple[int, int, int]]
) -> None:
    positions, triangles = np.array(rows), np.array(faces, np.int64) % len(rows)
    try:
        welded = weld(positions, triangles)
    except AssetEmptyError:
        return
    reach = 2 * WELD_TOLERANCE * np.linalg.norm(np.ptp(positions, axis=0))
    used = welded.vertex_map >= 0
    gap = np.linalg.norm(welded.mesh.verts[welded.vertex_map[used]] - positions[used], axis=1)
    assert (gap <= reach).all()
    assert len(welded.face_source) == len(triangles) - welded.skipped["degenerate_faces"]
    corners = welded.vertex_map[triangles[welded.face_source]]
    assert np.array_equal(corners, welded.mesh.faces)
