"""T-junctions: which vertices lie on an edge of another face, how they follow it, and how many came off."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.geometry import junctions
from meshdeform.geometry.junctions import Junctions, opened
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from training.shapes import box, grid

Floats = NDArray[np.float64]


def mesh_of(points: list[tuple[float, ...]], faces: list[tuple[int, int, int]]) -> TriangleMesh:
    verts = np.array([(*point, 0.0)[:3] for point in points], np.float64)
    return TriangleMesh(verts, np.array(faces))


def found(mesh: TriangleMesh) -> Junctions:
    return Junctions.of(mesh.verts, mesh.faces)


def moved(mesh: TriangleMesh, x: float, y: float, z: float = 0.0) -> TriangleMesh:
    return TriangleMesh(mesh.verts + np.array([x, y, z], np.float64), mesh.faces)


# An edge from 0 to 1 with a triangle above, and below it triangles that divide it at 3 and 4.
PLATE = mesh_of([(0, 0), (4, 0), (2, 2), (1, 0), (3, 0), (2, -2)], [(0, 1, 2), (0, 5, 3), (3, 5, 4), (4, 5, 1)])
# Below, 3 divides the edge from 0 to 1; above, a strip ends at 4, on the edge from 0 to 3.
CHAIN = mesh_of(
    [(0, 0), (4, 0), (2, 2), (2, 0), (1, 0), (1, -1), (0, -1), (3, -2)],
    [(0, 1, 2), (0, 7, 3), (3, 7, 1), (0, 5, 4), (0, 6, 5)],
)


def test_vertices_on_an_edge_follow_it_in_proportion() -> None:
    seen = found(PLATE)
    assert seen.verts.tolist() == [3, 4]
    assert seen.ends.tolist() == [[0, 1], [0, 1]]
    np.testing.assert_allclose(seen.shares, [0.25, 0.75])
    shifts = np.random.default_rng(0).normal(size=(6, 3))
    carried = seen.carried(shifts)
    np.testing.assert_array_equal(carried[[0, 1, 2, 5]], shifts[[0, 1, 2, 5]])
    np.testing.assert_allclose(carried[3], 0.75 * shifts[0] + 0.25 * shifts[1])
    np.testing.assert_array_equal(seen.closed(PLATE.verts, PLATE.verts), PLATE.verts)


def test_a_chain_is_followed_to_its_end() -> None:
    seen = found(CHAIN)
    assert dict(zip(seen.verts.tolist(), seen.ends.tolist(), strict=True)) == {3: [0, 1], 4: [0, 3]}
    shifts = np.random.default_rng(0).normal(size=(8, 3))
    np.testing.assert_allclose(seen.carried(shifts)[4], 0.75 * shifts[0] + 0.25 * shifts[1])


def test_borders_that_interleave_stay_on_one_line() -> None:
    # Edges from 0 to 2 and from 1 to 3: 1 lies on the first and 2 on the second.
    mesh = mesh_of([(0, 0), (1, 0), (2, 0), (3, 0), (1, 1), (2, -1)], [(0, 2, 4), (1, 5, 3)])
    seen = found(mesh)
    assert seen.verts.tolist() == [1, 2]
    shifts = np.random.default_rng(0).normal(size=(6, 3))
    carried = seen.carried(shifts)
    np.testing.assert_allclose(carried[1], (2 * shifts[0] + shifts[3]) / 3)
    np.testing.assert_allclose(carried[2], (shifts[0] + 2 * shifts[3]) / 3)


def test_rings_are_followed_exactly_up_to_a_length(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [(float(x), 0.0) for x in range(12)]
    above = [(x, x + 2, 12) for x in range(0, 10, 2)]
    below = [(x, 13, x + 2) for x in range(1, 11, 2)]
    mesh = mesh_of([*points, (5.0, 4.0), (5.0, -4.0)], [*above, *below])
    seen = found(mesh)
    assert seen.verts.tolist() == list(range(1, 11))
    shifts = np.random.default_rng(0).normal(size=(14, 3))
    along = np.arange(12)[:, None] / 11
    np.testing.assert_allclose(seen.carried(shifts)[:12], (1 - along) * shifts[0] + along * shifts[11])
    monkeypatch.setattr(junctions, "_LONGEST", 9)
    assert len(found(mesh)) == 0


def test_a_fine_disc_in_a_fine_hole_follows_nothing() -> None:
    # Each vertex lies on an edge of the other border, all around: none would be free.
    angle = np.arange(4000) / 4000 * 2 * np.pi
    circle = [(float(np.cos(a)), float(np.sin(a))) for a in angle]
    inner = [(k, (k + 2) % 4000, 4000) for k in range(0, 4000, 2)]
    outer = [(k, 4001, (k + 2) % 4000) for k in range(1, 4000, 2)]
    mesh = mesh_of([*circle, (0.0, 0.0), (0.0, 0.0, 9.0)], [*inner, *outer])
    assert len(found(mesh)) == 0


def beside(mesh: TriangleMesh, x: float, y: float) -> TriangleMesh:
    return join(grid(1, 2.0), moved(mesh, x, y))


@each_case(
    "mesh",
    [
        icosphere(2),
        join(box(1), moved(box(1, (0.5, 1.0, 0.5)), 0.0, 1.0)),  # closed boxes, one on the other
        join(box(2), moved(box(3), 1.0, 0.0)),  # with divided edges along each other
        beside(mesh_of([(0, 0), (-1, -1), (1, -1)], [(0, 1, 2)]), 0.0, -1.0),  # a corner that touches a border
        beside(mesh_of([(0, 0), (1, 0), (0.5, 0, 1)], [(0, 1, 2)]), -0.5, 0.0),  # a sheet that stands on a face
        beside(moved(box(1), -0.5, -0.5), 0.0, -1.5),  # a closed box along a border
        TriangleMesh(PLATE.verts, np.concatenate([PLATE.faces[:1], PLATE.faces[:1][:, ::-1]])),
    ],
)
def test_what_is_no_crack_has_none(mesh: TriangleMesh) -> None:
    assert len(found(mesh)) == 0


def test_sheets_along_each_other_are_tied_whatever_they_belong_to() -> None:
    mesh = beside(grid(4, 1.0), 0.0, -1.5)
    seen = found(mesh)
    assert len(seen) == 5
    assert RestMesh.of(mesh).num_components == 2
    assert RestMesh.of(mesh).joined.max() == 0


def test_copies_of_a_sheet_have_the_same() -> None:
    doubled = TriangleMesh(PLATE.verts, np.concatenate([PLATE.faces, PLATE.faces[:, ::-1]]))
    assert found(doubled).verts.tolist() == [3, 4]


@each_case("scale", [1e-3, 1.0, 1e4])
def test_scale_and_rotation_and_small_offsets_find_the_same(scale: float) -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    noise = np.random.default_rng(2).normal(size=(6, 3)) * 1e-7
    points = scale * ((PLATE.verts + noise) @ turn.T + 3.0)
    seen = Junctions.of(points, PLATE.faces)
    assert seen.verts.tolist() == [3, 4]
    np.testing.assert_allclose(seen.shares, [0.25, 0.75], atol=1e-6)
    points[3] += scale * 1e-3
    assert Junctions.of(points, PLATE.faces).verts.tolist() == [4]


def test_a_search_that_would_list_too_many_pairs_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(junctions, "_MOST", 1)
    monkeypatch.setattr(junctions, "_MOST_OF_EDGE", 0)
    points, faces = PLATE.verts, PLATE.faces
    assert len(found(PLATE)) == 0
    assert opened(points, faces, points) is None


def test_the_search_agrees_with_all_pairs() -> None:
    random = np.random.default_rng(0)
    corners = random.integers(0, 9, (300, 3, 2)).astype(np.float64)
    points = np.concatenate([corners.reshape(-1, 2), np.zeros((900, 1))], 1)
    places, welded = np.unique(points, axis=0, return_inverse=True)
    faces = welded.reshape(-1, 3)
    a, b, c = places[faces].transpose(1, 0, 2)
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0][:40]
    edges = junctions._border(faces)
    verts, edge = junctions._on_edges(places, edges, 1e-5)
    expected = []
    for number, (first, second) in enumerate(edges):
        for v in np.unique(edges):
            line, arm = places[second] - places[first], places[v] - places[first]
            share = float(arm @ line / (line @ line))
            if 0 < share < 1 and np.linalg.norm(arm - share * line) < 1e-9:
                expected.append((int(v), number))
    assert sorted(zip(verts.tolist(), edge.tolist(), strict=True)) == sorted(expected)
    assert len(expected) > 10


def test_ends_of_edges_are_held_with_what_lies_on_them() -> None:
    seen = found(CHAIN)
    held = np.zeros(8, bool)
    held[4] = True
    assert np.flatnonzero(seen.completed(held)).tolist() == [0, 1, 3, 4]
    assert seen.without(held).verts.tolist() == [3]


def test_vertices_that_came_off_their_edge_are_counted() -> None:
    points, faces = PLATE.verts, PLATE.faces
    assert measure(points, faces, points).opened_junctions == 0
    assert measure(points, faces, 3 * points + 1).opened_junctions == 0
    off = points.copy()
    off[3, 1] -= 0.1
    quality = measure(points, faces, off)
    assert quality.opened_junctions == 1
    assert quality.warnings(4) == ["Cracks opened: 1 of the vertices on edges of other faces came off."]
    along = points.copy()
    along[3, 0] += 0.5  # a vertex that slides along its edge leaves no gap
    assert measure(points, faces, along).opened_junctions == 0
