"""Jacobians map rest edges to deformed edges; completed ones know similarities."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from meshdeform.deformation.poisson import completed_jacobians, jacobians_from_verts
from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import TriangleMesh, face_areas, face_normals, gradient_operator
from meshdeform.geometry.shapes import icosphere
from tests.cases import each_case
from tests.close import assert_close
from training.shapes import box, grid, torus

DEFORMED = [icosphere(1), box(2), grid(3), torus(n=8, m=6)]


def noise(mesh: TriangleMesh, size: float = 0.1, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return mesh.verts + size * torch.randn(mesh.verts.shape, generator=generator, dtype=torch.float64)


def rotation(seed: int = 0) -> Tensor:
    square = torch.randn(3, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    q = torch.linalg.qr(square).Q
    return q * torch.linalg.det(q)


@each_case("mesh", DEFORMED)
def test_edges_go_to_edges(mesh: TriangleMesh) -> None:
    verts = noise(mesh)
    for jacobians in (
        jacobians_from_verts(gradient_operator(mesh), verts),
        completed_jacobians(mesh, verts),
    ):
        for i, j in ((0, 1), (1, 2), (2, 0)):
            old = mesh.verts[mesh.faces[:, j]] - mesh.verts[mesh.faces[:, i]]
            new = verts[mesh.faces[:, j]] - verts[mesh.faces[:, i]]
            assert_close((jacobians @ old[:, :, None])[:, :, 0], new, atol=1e-12, rtol=0)


def test_the_maps_own_jacobian_forgets_the_normal_and_the_completed_one_scales_it() -> None:
    mesh = icosphere(1)
    verts = noise(mesh)
    with pytest.raises(ShapeError):
        jacobians_from_verts(gradient_operator(mesh), verts[1:])
    normals = face_normals(mesh.verts, mesh.faces)[:, :, None]
    plain = jacobians_from_verts(gradient_operator(mesh), verts)
    assert float((plain @ normals).abs().max()) < 1e-13
    stretch = (face_areas(verts, mesh.faces) / face_areas(mesh.verts, mesh.faces)).sqrt()
    moved = (completed_jacobians(mesh, verts) @ normals)[:, :, 0]
    assert_close(moved, stretch[:, None] * face_normals(verts, mesh.faces), atol=1e-12, rtol=0)


@each_case("mesh", DEFORMED)
def test_a_similarity_is_itself_on_every_face(mesh: TriangleMesh) -> None:
    similarity = 2.5 * rotation()
    found = completed_jacobians(mesh, mesh.verts @ similarity.T + 7)
    assert_close(found, similarity.expand_as(found), atol=1e-12, rtol=0)


def test_collapsed_faces_are_finite_before_and_after() -> None:
    verts = torch.tensor([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], dtype=torch.float64)
    faces = torch.tensor([[0, 1, 2], [0, 1, 3]])
    found = completed_jacobians(TriangleMesh(verts, faces), verts * torch.tensor([1.0, 0.0, 1.0], dtype=torch.float64))
    assert torch.equal(found[0], torch.eye(3, dtype=torch.float64))
    assert_close(found[1], torch.diag(torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)))
