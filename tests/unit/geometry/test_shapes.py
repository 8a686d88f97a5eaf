"""The manufactured meshes are what their names say: closed or open, outward, of the right volume."""

from __future__ import annotations

import math

import pytest
import torch

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import TriangleMesh, edges_of, face_areas
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from tests.close import assert_close
from training.shapes import box, cylinder, grid, lathe, torus, uv_sphere


def volume(mesh: TriangleMesh) -> float:
    a, b, c = mesh.verts[mesh.faces].unbind(1)
    return float((a * torch.linalg.cross(b, c)).sum() / 6)


@each_case(
    ("mesh", "expected"),
    [
        (icosphere(4), 4 / 3 * math.pi),
        (icosphere(4, 0.5), math.pi / 6),
        (uv_sphere(64, 128), 4 / 3 * math.pi),
        (torus(1.0, 0.25, 128, 64), 2 * math.pi**2 * 0.25**2),
        (cylinder(0.5, 3.0, 128), 0.75 * math.pi),
        (box(1), 1.0),
        (box(3, (1.0, 2.0, 0.5)), 1.0),
        (lathe([(0.0, 0.0), (1.0, 0.0), (0.0, 3.0)], 128), math.pi),
        (join(icosphere(4), icosphere(4)), 8 / 3 * math.pi),
    ],
)
def test_closed_shapes_enclose_their_volume_outward(mesh: TriangleMesh, expected: float) -> None:
    edges = edges_of(mesh.faces)
    assert bool((edges.counts == 2).all())
    assert bool(edges.consistent.all())
    assert float(face_areas(mesh.verts, mesh.faces).min()) > 0
    assert volume(mesh) == pytest.approx(expected, rel=5e-3)


@each_case(("mesh", "borders"), [(grid(5), 20), (cylinder(n=12, capped=False), 24)])
def test_open_shapes_have_their_borders(mesh: TriangleMesh, borders: int) -> None:
    edges = edges_of(mesh.faces)
    assert int((edges.counts == 1).sum()) == borders
    assert bool(edges.consistent[edges.counts == 2].all())


@each_case("level", [0, 1, 2, 3])
def test_an_icosphere_has_twenty_times_four_to_the_level_faces(level: int) -> None:
    mesh = icosphere(level)
    assert mesh.faces.shape[0] == 20 * 4**level
    assert mesh.verts.shape[0] == 10 * 4**level + 2
    assert_close(mesh.verts.norm(dim=1), torch.ones(len(mesh.verts), dtype=torch.float64))


def test_the_grid_faces_forward() -> None:
    mesh = grid(2, size=3.0)
    a, b, c = mesh.verts[mesh.faces].unbind(1)
    normals = torch.linalg.cross(b - a, c - a)
    assert bool((normals[:, 2] > 0).all())
    assert float(face_areas(mesh.verts, mesh.faces).sum()) == pytest.approx(9.0)


@each_case("profile", [[(1.0, 0.0)], [(1.0, 0.0), (-1.0, 1.0)], [(1.0, 0.0), (0.0, 1.0), (1.0, 2.0)]])
def test_a_lathe_refuses_what_it_cannot_turn(profile: list[tuple[float, float]]) -> None:
    with pytest.raises(ShapeError):
        lathe(profile)
