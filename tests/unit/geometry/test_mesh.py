"""Edges, areas, normals and components of good meshes and of triangle soups."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import (
    TriangleMesh,
    connected_components,
    edges_of,
    face_areas,
    face_normals,
    safe_normalize,
)
from meshdeform.geometry.shapes import grid, icosphere, join, torus
from tests.cases import each_case
from tests.close import assert_close


def tensor(rows: list[list[float]]) -> torch.Tensor:
    return torch.tensor(rows, dtype=torch.float64)


@each_case(
    ("verts", "faces"),
    [
        (torch.zeros(3, 3), torch.zeros(1, 3, dtype=torch.int64)),
        (torch.zeros(3, 2, dtype=torch.float64), torch.zeros(1, 3, dtype=torch.int64)),
        (torch.zeros(3, 3, dtype=torch.float64), torch.zeros(1, 3, dtype=torch.int32)),
        (torch.zeros(3, 3, dtype=torch.float64), torch.tensor([[0, 1, 3]])),
        (torch.zeros(3, 3, dtype=torch.float64), torch.tensor([[0, 1, -1]])),
    ],
)
def test_what_is_no_mesh_is_refused(verts: torch.Tensor, faces: torch.Tensor) -> None:
    with pytest.raises(ShapeError):
        TriangleMesh(verts, faces)


@each_case(("mesh", "characteristic"), [(icosphere(2), 2), (torus(), 0), (grid(4), 1)])
def test_edges_satisfy_eulers_formula(mesh: TriangleMesh, characteristic: int) -> None:
    edges = edges_of(mesh.faces)
    assert mesh.verts.shape[0] - edges.edges.shape[0] + mesh.faces.shape[0] == characteristic
    assert int(edges.counts.sum()) == 3 * mesh.faces.shape[0]


def test_each_edge_knows_both_sides() -> None:
    mesh = icosphere(1)
    edges = edges_of(mesh.faces)
    assert bool(edges.consistent.all())
    for side in (0, 1):
        corners = torch.cat([edges.edges, edges.opposite[:, side : side + 1]], 1).sort(1).values
        assert torch.equal(corners, mesh.faces[edges.faces[:, side]].sort(1).values)


def test_borders_and_fans_of_three_faces() -> None:
    edges = edges_of(torch.tensor([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    assert edges.edges[0].tolist() == [0, 1]
    assert edges.counts.tolist() == [3, 1, 1, 1, 1, 1, 1]
    assert edges.faces[0].tolist() == [0, 1]
    assert edges.faces[1:, 1].tolist() == [-1] * 6
    assert edges.opposite[1:, 1].tolist() == [-1] * 6
    assert edges.consistent.tolist() == [True] + [False] * 6


def test_neighbours_wound_against_each_other_are_told() -> None:
    edges = edges_of(torch.tensor([[0, 1, 2], [0, 1, 3]]))
    assert not bool(edges.consistent.any())


def test_no_faces_have_no_edges() -> None:
    edges = edges_of(torch.zeros(0, 3, dtype=torch.int64))
    assert edges.edges.shape == edges.faces.shape == edges.opposite.shape == (0, 2)
    assert edges.counts.shape == edges.consistent.shape == (0,)


def test_area_and_normal_of_one_triangle() -> None:
    verts = tensor([[0, 0, 0], [2, 0, 0], [0, 3, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 1]])
    assert face_areas(verts, faces).tolist() == [3.0, 3.0]
    assert face_normals(verts, faces).tolist() == [[0, 0, 1], [0, 0, -1]]


def test_collapsed_faces_have_zero_normals_and_zero_gradients() -> None:
    verts = tensor([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0]]).requires_grad_()
    faces = torch.tensor([[0, 1, 2], [0, 3, 0]])
    (face_normals(verts, faces).sum() + face_areas(verts, faces).sum()).backward()
    assert face_normals(verts, faces).abs().max() == 0
    assert verts.grad is not None
    assert verts.grad.abs().max() == 0


def test_normalising_is_differentiable_and_of_length_one() -> None:
    vectors = torch.randn(5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    assert_close(safe_normalize(vectors).norm(dim=1), torch.ones(5, dtype=torch.float64))
    assert torch.autograd.gradcheck(safe_normalize, (vectors,))


def test_components_are_what_faces_connect() -> None:
    mesh = join(icosphere(0), torus(n=4, m=3), grid(1))
    labels = connected_components(mesh.faces, mesh.verts.shape[0] + 2)
    assert torch.bincount(labels).tolist() == [12, 12, 4, 1, 1]
    assert bool((labels[mesh.faces] == labels[mesh.faces[:, :1]]).all())


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(*[st.integers(0, 7)] * 3), max_size=20))
def test_any_soup_has_edges(rows: list[tuple[int, int, int]]) -> None:
    faces = torch.tensor(rows, dtype=torch.int64).reshape(-1, 3)
    edges = edges_of(faces)
    assert int(edges.counts.sum()) == 3 * len(rows)
    assert bool(((edges.counts > 1) == (edges.faces[:, 1] >= 0)).all())
