"""Thousands of faces that lie on or in each other: searches take bounded work and memory, and say what is left out."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from meshdeform.deformation import lattice
from meshdeform.deformation.lattice import Lattice
from meshdeform.deformation.path import ShapePath
from meshdeform.deformation.surface_guard import SurfaceGuard
from meshdeform.deformation.variables import Adam, Elements, placed
from meshdeform.geometry import intersections, nearest_points
from meshdeform.geometry.intersections import TooManyPairsError, cutting_pairs, intersecting_faces, touching_pairs
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import NearestPoints
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere, simplified
from meshdeform.geometry.surface_samples import count_samples, sample_blocks, samples_of
from meshdeform.requests.document import Safeguard
from tests.displacements import VertexDisplacements
from training.shapes import box, torus

MIB = 1 << 20


def boxes(offsets: NDArray[np.float64]) -> TriangleMesh:
    """One box at each of the offsets (N, 3)."""
    one = box(1)
    verts = (one.verts + offsets[:, None]).reshape(-1, 3)
    faces = one.faces + len(one.verts) * np.arange(len(offsets))[:, None, None]
    return TriangleMesh(verts, faces.reshape(-1, 3))


CROWD = boxes(np.random.default_rng(0).normal(0, 0.05, (2000, 3)))
COPIES = boxes(np.zeros((2000, 3)))


@contextmanager
def memory_below(most: int) -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("mesh", [CROWD, COPIES], ids=["through each other", "in one place"])
def test_searches_for_pairs_give_up(mesh: TriangleMesh) -> None:
    verts, faces = mesh.verts, mesh.faces
    with memory_below(256 * MIB):
        for search in (intersecting_faces, cutting_pairs):
            with pytest.raises(TooManyPairsError):
                search(verts, faces)
        with pytest.raises(TooManyPairsError):
            touching_pairs(verts, faces, np.full(len(faces), 1e-4))


def test_a_block_of_boxes_that_touch_is_searched() -> None:
    """512 boxes: the 3 * 64 * 7 pairs that share a side have the two triangles of each on each other."""
    mesh = boxes(np.stack(np.meshgrid(*[np.arange(8.0)] * 3), -1).reshape(-1, 3))
    verts, faces = mesh.verts, mesh.faces
    assert not intersecting_faces(verts, faces).any()
    pairs = np.unique(touching_pairs(verts, faces, np.full(len(faces), 1e-4)) // 12, axis=0)
    offset = np.abs(np.diff(verts.reshape(512, -1, 3)[pairs].mean(2), axis=1))[:, 0]
    assert ((offset.round(9) == 1).sum(1) >= 1).all()
    assert (offset.sum(1).round(9) == 1).sum() == 3 * 64 * 7


def test_too_many_pairs_are_counted_as_unknown() -> None:
    verts, faces = CROWD.verts, CROWD.faces
    quality = measure(verts, faces, 2 * verts)
    assert quality.self_intersecting_faces_before is None
    assert quality.self_intersecting_faces_after is None
    assert quality.self_intersections_added is None
    assert (quality.flipped_faces, quality.collapsed_faces) == (0, 0)
    assert "not counted" in quality.warnings(len(faces))[0]
    ball = icosphere(2)
    assert measure(ball.verts, ball.faces, ball.verts).warnings(len(ball.faces)) == []


def dented(variables: VertexDisplacements, depth: float) -> None:
    """Push the top of a sphere down through its bottom, without a fold for a depth of 2.6."""
    verts = variables.rest.verts
    near = np.exp(-8 * ((verts - verts[verts[:, 1].argmax()]) ** 2).sum(1))
    with torch.no_grad():
        variables.tensors["displacements"].zero_()
        variables.tensors["displacements"][:, 1] = torch.from_numpy(-depth * near)


def test_the_guard_finds_only_folds_from_then_on_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    ball = icosphere(2)
    variables = VertexDisplacements(ball)
    optimizer = Adam([{"params": list(variables.tensors.values()), "lr": 1.0}])
    guard = SurfaceGuard(Safeguard.INTERSECTIONS, ball, variables)
    usual = set(guard.state)
    dented(variables, 2.6)
    cut = placed(variables).detach().clone()
    assert guard.correct(optimizer) > 0
    assert (guard.crowded, guard.warnings) == (False, [])
    with monkeypatch.context() as limits:
        limits.setattr(intersections, "_TESTS", 0)
        limits.setattr(intersections, "_TESTS_OF_FACE", 0)
        at_rest = SurfaceGuard(Safeguard.INTERSECTIONS, ball, VertexDisplacements(ball))
        guard.correct(optimizer)
    assert at_rest.crowded
    assert guard.crowded
    assert "only prevented folds" in guard.warnings[0]
    # Of the same run after a restart.
    resumed = SurfaceGuard(Safeguard.INTERSECTIONS, ball, variables)
    assert not resumed.crowded
    resumed.restore(guard.state)
    assert resumed.crowded
    assert set(guard.state) - usual == {"guard.crowded"}
    flips = SurfaceGuard(Safeguard.FLIPS, ball, VertexDisplacements(ball))
    for each in (guard, resumed, flips):
        own = each._variables
        dented(own, 2.6)  # type: ignore[arg-type]
        assert torch.equal(placed(own).detach(), cut)
        each.correct(Adam([{"params": list(own.tensors.values()), "lr": 1.0}]))
    assert torch.equal(placed(variables), placed(flips._variables))


def test_elements_spread_to_all_that_share_a_control_point() -> None:
    mesh = RestMesh.of(torus())
    elements, faces = Elements.faces_of(mesh), mesh.faces
    beside = (faces[:, None, :, None] == faces[None, :, None, :]).any((2, 3))
    flags = np.zeros(len(faces), bool)
    flags[[3, 200]] = True
    assert np.array_equal(elements.spread(flags), beside[flags].any(0))
    count, group = elements.regions(np.flatnonzero(beside[3] | beside[200]))
    assert count == 2
    assert set(group[np.isin(np.flatnonzero(beside[3] | beside[200]), np.flatnonzero(beside[3]))]) == {group[0]}
    # Around one vertex, the pairs would take gigabytes.
    rest = RestMesh.of(TriangleMesh(box(1).verts, np.tile(box(1).faces, (2000, 1))))
    with memory_below(64 * MIB):
        assert Elements.faces_of(rest).spread(np.arange(len(rest.faces)) == 0).sum() > 12_000


def test_the_way_of_many_faces_around_one_vertex_takes_little_memory() -> None:
    """5,000 triangles with one common vertex, turned by 100 degrees: half-way they are turned by 50."""
    count = 5000
    verts = np.random.default_rng(1).normal(size=(2 * count + 1, 3))
    verts[0] = 0
    faces = np.stack([np.zeros(count, int), 1 + 2 * np.arange(count), 2 + 2 * np.arange(count)], 1)
    mesh = TriangleMesh(verts, faces)
    whole, half = (Rotation.from_rotvec([0, np.radians(degrees), 0]).as_matrix() for degrees in (100, 50))
    with memory_below(256 * MIB):
        found = ShapePath(mesh, verts @ whole.T).at(0.5)
    moved = verts @ half.T
    np.testing.assert_allclose(found - found[0], moved - moved[0], atol=1e-6)


def test_a_mesh_with_too_many_faces_around_its_vertices_is_not_simplified() -> None:
    crowded = TriangleMesh(box(1).verts, np.tile(box(1).faces, (2000, 1)))
    assert simplified(crowded, 8000) is crowded
    ball = icosphere(4)
    assert len(simplified(ball, 1000).faces) < 1100 < len(ball.faces)


def test_samples_come_in_blocks_with_all_of_a_face(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = icosphere(2)
    verts, faces = mesh.verts, mesh.faces
    points, owners = samples_of(verts, faces, 0.05)
    assert count_samples(verts, faces, 0.05) == len(points)
    monkeypatch.setattr("meshdeform.geometry.surface_samples._BLOCK", 100)
    blocks = list(sample_blocks(verts, faces, 0.05))
    assert len(blocks) > 10
    assert max(len(block) for block, _ in blocks) <= 150
    assert np.array_equal(np.concatenate([block for block, _ in blocks]), points)
    assert np.array_equal(np.concatenate([owner for _, owner in blocks]), owners)
    assert sum(len(np.unique(owner)) for _, owner in blocks) == len(faces)


def test_a_lattice_around_large_faces_is_coarser_and_says_so() -> None:
    with memory_below(400 * MIB):
        found = Lattice.around(RestMesh.of(CROWD))
    assert found.coarse
    assert "coarser" in found.warnings[0]
    assert count_samples(CROWD.verts, CROWD.faces, found.spacing / 2) <= lattice.MAX_SAMPLES
    usual = Lattice.around(RestMesh.of(icosphere(3)))
    assert (usual.coarse, usual.warnings) == (False, [])


def test_the_nearest_place_is_found_with_fewer_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = RestMesh.of(torus())
    points = np.random.default_rng(2).normal(size=(500, 3))
    usual = NearestPoints(mesh, points, np.zeros_like(points)).distances(points)
    monkeypatch.setattr(nearest_points, "_SAMPLES", 0)
    monkeypatch.setattr(nearest_points, "_SAMPLES_OF_FACE", 4)
    fewer = NearestPoints(mesh, points, np.zeros_like(points)).distances(points)
    np.testing.assert_allclose(fewer, usual, atol=1e-12)
    monkeypatch.undo()
    # Needles, whose samples at the mean edge's distance would be ten million, with six coordinates each.
    needles = np.zeros((2000, 3, 3))
    needles[:, 1, 0], needles[:, 2, 0], needles[:, 2, 1] = 1.0, 1.0, 1e-4
    rest = RestMesh.of(TriangleMesh(needles.reshape(-1, 3), np.arange(6000).reshape(-1, 3)))
    above = np.array([[0.5, 0.0, 2.0]])
    with memory_below(400 * MIB):
        distance = NearestPoints(rest, above, np.zeros((1, 3))).distances(above)
    assert distance == pytest.approx(2.0)
