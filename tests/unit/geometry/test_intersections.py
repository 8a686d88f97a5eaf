"""Known answers: clean meshes have no cut faces, crossing ones have exactly those at the seam."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from meshdeform.geometry import intersections
from meshdeform.geometry.cuts import cut, touch
from meshdeform.geometry.intersections import TooManyPairsError, cutting_pairs, intersecting_faces, touching_pairs
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from training.shapes import box, cylinder, grid, torus, uv_sphere


@pytest.fixture(autouse=True, params=[True, False], ids=["numba", "numpy"])
def _both_searches(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Search for cuts by what large meshes take, and by what small ones do."""
    monkeypatch.setattr(intersections, "_compiles", lambda _count: request.param)


def moved(mesh: TriangleMesh, *by: float) -> TriangleMesh:
    return TriangleMesh(mesh.verts + np.array(by, np.float64), mesh.faces)


def hits(mesh: TriangleMesh) -> NDArray[np.bool_]:
    return intersecting_faces(mesh.verts, mesh.faces)


@each_case(
    "mesh",
    [
        icosphere(3),
        uv_sphere(12, 60),
        torus(),
        box(4),
        cylinder(),
        grid(12),
        join(icosphere(2), moved(box(2), 3, 0, 0)),
    ],
)
def test_clean_meshes_have_none(mesh: TriangleMesh) -> None:
    assert not hits(mesh).any()


def pair(second: list[list[float]], share: int = 0) -> TriangleMesh:
    """The triangle (0 0 0) (2 0 0) (0 2 0) and another one; the other's first `share` corners are the first's."""
    first = [[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]
    verts = np.array([*first, *second], np.float64)
    corners = [*range(share), *range(3, 6 - share)]
    return TriangleMesh(verts, np.array([[0, 1, 2], corners]))


@each_case(
    ("mesh", "cut"),
    [
        (pair([[0.5, 0.5, -1], [0.5, 0.5, 1], [3, 3, 1]]), True),
        (pair([[0.5, 0.5, 0.1], [0.5, 0.5, 1], [3, 3, 1]]), False),
        # An edge of the first through the inside of the second.
        (pair([[1, -1, -1], [1, 1, -1], [1, 0, 1]]), True),
        # Exactly through the first's border, and exactly through its corner.
        (pair([[1, 0, -1], [1, 0, 1], [1, -1, 0.5]]), True),
        (pair([[0, 0, -1], [0, 0, 1], [-1, -1, 0.5]]), True),
        # Its tip in the plane: touching.
        (pair([[0.5, 0.5, 0], [0.5, 0.5, 1], [1, 1, 1]]), False),
        # In one plane, overlapping: no cut by definition.
        (pair([[0.1, 0.1, 0], [0.5, 0.1, 0], [0.1, 0.5, 0]]), False),
        # One common vertex: through the inside, beside it, and folded flat.
        (pair([[0.5, 0.5, -1], [0.5, 0.6, 1]], share=1), True),
        (pair([[-0.5, -0.5, -1], [-0.5, -0.6, 1]], share=1), False),
        (pair([[0.5, 0.5, 0], [0.5, 0.6, 0]], share=1), False),
        # One common edge never counts.
        (pair([[0.5, 0.5, 1e-9]], share=2), False),
    ],
)
def test_two_triangles(mesh: TriangleMesh, cut: bool) -> None:
    expected = [cut, cut]
    assert hits(mesh).tolist() == expected
    for order in ([1, 2, 0], [2, 1, 0]):
        turned = TriangleMesh(mesh.verts, mesh.faces[::-1, order])
        assert hits(turned).tolist() == expected


def test_it_agrees_with_all_pairs_on_random_soups() -> None:
    rng = np.random.default_rng(0)
    verts = rng.random((60, 3))
    faces = np.stack([rng.permutation(60)[:3] for _ in range(80)])
    expected = np.zeros(80, bool)
    for i in range(80):
        for j in range(i):
            if len(set(faces[i]) & set(faces[j])) == 0 and _crosses(verts[faces[i]], verts[faces[j]]):
                expected[[i, j]] = True
    found = intersecting_faces(verts, faces)
    assert (found >= expected).all()
    apart = np.arange(180).reshape(60, 3)
    scattered = rng.random((180, 3)) * 0.3 + np.repeat(rng.random((60, 1, 3)), 3, 1).reshape(180, 3)
    brute = np.zeros(60, bool)
    pairs = [(i, j) for i in range(60) for j in range(i + 1, 60) if _crosses(scattered[apart[i]], scattered[apart[j]])]
    brute[np.unique(pairs)] = True
    assert 0 < brute.sum() < 60
    assert np.array_equal(intersecting_faces(scattered, apart), brute)
    assert cutting_pairs(scattered, apart).tolist() == [list(pair) for pair in pairs]


def _crosses(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """By linear algebra: some edge meets the other triangle at barycentric coordinates inside it."""
    for one, other in ((first, second), (second, first)):
        for k in range(3):
            start, end = one[k], one[(k + 1) % 3]
            matrix = np.stack([other[1] - other[0], other[2] - other[0], start - end], 1)
            u, v, t = np.linalg.solve(matrix, start - other[0])
            if u > 0 and v > 0 and u + v < 1 and 0 < t < 1:
                return True
    return False


def test_a_flat_sheet_does_not_cut_itself_however_it_is_turned() -> None:
    """All determinants are rounding errors, so only where an edge crosses the plane tells the triangles apart."""
    sheet = grid(20)
    for seed in range(30):
        generator = np.random.default_rng(seed)
        flat = sheet.verts + np.pad(generator.uniform(-0.01, 0.01, (len(sheet.verts), 2)), ((0, 0), (0, 1)))
        turned = (flat + [0, 0, 1]) @ Rotation.random(random_state=seed).as_matrix()
        assert not intersecting_faces(turned, sheet.faces).any(), seed


def test_who_cuts_whom() -> None:
    """Needles through a stack of squares: each cuts one triangle of every square that its length reaches, and no other.

    Squares at z = 0, 1, 2 of two triangles each, x > y and x < y; needles from below at places well inside one of them.
    """
    corners = [[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]
    verts = [[x, y, z] for z in range(3) for x, y, _ in corners]
    faces = [[4 * k + i for i in half] for k in range(3) for half in ((0, 1, 2), (0, 2, 3))]
    for x, y, top in ((3.0, 1.0, 0.5), (1.0, 3.0, 1.5), (3.2, 1.4, 2.5), (2.0, 1.0, -0.5)):
        tip = len(verts)
        verts += [[x, y, top], [x + 0.1, y, -1.0], [x, y + 0.1, -1.0]]
        faces.append([tip, tip + 1, tip + 2])
    expected = [[0, 6], [0, 8], [1, 7], [2, 8], [3, 7], [4, 8]]
    points, triangles = np.array(verts), np.array(faces)
    assert cutting_pairs(points, triangles).tolist() == expected
    # Whatever the faces' order, the axis and the layout in memory.
    order = np.random.default_rng(0).permutation(len(faces))
    turned = cutting_pairs(np.asfortranarray(points[:, [2, 0, 1]]), triangles[order])
    assert sorted(np.sort(order[turned], axis=1).tolist()) == expected
    assert (turned[:, 0] < turned[:, 1]).all()
    assert cutting_pairs(points, triangles[:6]).shape == (0, 2)


def test_nothing_to_compare() -> None:
    assert intersecting_faces(np.zeros((0, 3)), np.zeros((0, 3), np.int64)).shape == (0,)
    assert not intersecting_faces(np.eye(3), np.array([[0, 1, 2]])).any()
    assert not intersecting_faces(np.zeros((6, 3)), np.arange(6).reshape(2, 3)).any()
    assert cutting_pairs(np.zeros((0, 3)), np.zeros((0, 3), np.int64)).shape == (0, 2)


TRIANGLE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@each_case(
    ("other", "distance"),
    [
        (TRIANGLE + [0.1, 0.1, 0.01], 0.01),  # above: a corner and a face
        (TRIANGLE[[1, 2, 0]] * [1, 1, -1] + [0.2, 0.2, -0.03], 0.03),
        (TRIANGLE + [1.5, 0.0, 0.0], 0.5),  # beside it: a corner and a corner
        (np.array([[0.5, -0.2, -1.0], [0.5, -0.2, 1.0], [0.5, -2.0, 0.0]]), 0.2),  # edges that cross
        (TRIANGLE * 0.5 + [0.1, 0.1, 0.0], 0.0),  # one in the plane of the other
        (np.array([[0.2, 0.2, -1.0], [0.2, 0.2, 1.0], [5.0, 5.0, 0.0]]), 0.0),  # through it
        (np.array([[2.0, 2.0, 0.0]] * 3), math.sqrt(4.5)),  # a point
    ],
)
def test_triangles_touch_from_their_distance_on(other: NDArray[np.float64], distance: float) -> None:
    verts, faces = np.concatenate([TRIANGLE, other]), np.arange(6).reshape(2, 3)
    for reach, touching in ((distance + 1e-9, [[0, 1]]), (distance - 1e-9, [])):
        if reach > 0:
            assert touching_pairs(verts, faces, np.full(2, reach)).tolist() == touching
            assert touching_pairs(verts, faces, np.array([9.0, reach])).tolist() == touching


def test_faces_around_a_vertex_touch_only_where_they_lie_on_each_other() -> None:
    fan, flat = icosphere(2), np.full(320, 1e-6)
    assert len(touching_pairs(fan.verts, fan.faces, flat)) == 0
    # Two triangles with a common corner, the second one within the first.
    verts = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.1, 0], [0.1, 0.5, 0]], np.float64)
    pair = np.array([[0, 1, 2], [0, 3, 4]])
    assert touching_pairs(verts, pair, np.full(2, 1e-9)).tolist() == [[0, 1]]
    assert len(cutting_pairs(verts, pair)) == 0


def test_pairs_that_touch_agree_with_all_pairs() -> None:
    """A reach of 0.3 on a random soup, against distances of points sampled on every pair."""
    generator = np.random.default_rng(5)
    corners = generator.normal(size=(40, 1, 3)) * 2 + generator.normal(size=(40, 3, 3)) * 0.5
    faces = np.arange(120).reshape(40, 3)
    found = {tuple(pair) for pair in touching_pairs(corners.reshape(-1, 3), faces, np.full(40, 0.3)).tolist()}
    grid = np.array([(i, j, 20 - i - j) for i in range(21) for j in range(21 - i)]) / 20
    points = grid @ corners
    for first in range(40):
        for second in range(first + 1, 40):
            squared = ((points[first][:, None] - points[second][None]) ** 2).sum(2).min()
            near, far = squared < 0.3**2, squared > 0.45**2  # the samples are up to 0.15 apart
            if near or far:
                assert ((first, second) in found) == near
    pairs = np.stack(np.triu_indices(40, 1))
    touching = touch(corners.reshape(-1, 3).T, faces.T, *pairs, 0.3)
    assert {tuple(pair) for pair in pairs[:, touching].T.tolist()} == found


def test_a_sweep_gives_up_after_so_many_tests_and_finds_the_same_pairs_until_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    generator = np.random.default_rng(7)
    verts = (generator.normal(size=(300, 1, 3)) + generator.normal(size=(300, 3, 3))).reshape(-1, 3)
    faces = np.concatenate([np.arange(900).reshape(300, 3), generator.integers(0, 900, (60, 3))])
    found = cutting_pairs(verts, faces)
    everything = np.stack(np.triu_indices(len(faces), 1))
    assert np.array_equal(found, everything[:, cut(verts.T.copy(), faces.T, *everything)].T)
    assert 1000 < len(found) < everything.shape[1] / 4
    monkeypatch.setattr(intersections, "_TESTS", 0)
    monkeypatch.setattr(intersections, "_TESTS_OF_FACE", 1)
    with pytest.raises(TooManyPairsError):
        cutting_pairs(verts, faces)
