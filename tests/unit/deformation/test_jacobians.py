"""Jacobians map rest edges to deformed edges; completed ones know similarities."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.deformation.jacobians import completed_jacobians, jacobians_from_verts
from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh, face_areas, face_normals
from meshdeform.geometry.shapes import icosphere
from tests.cases import each_case
from tests.close import assert_close
from training.shapes import box, grid, torus

DEFORMED = [icosphere(1), box(2), grid(3), torus(n=8, m=6)]


def noise(mesh: TriangleMesh, size: float = 0.1, seed: int = 0) -> NDArray[np.float64]:
    return mesh.verts + size * np.random.default_rng(seed).normal(size=mesh.verts.shape)


def rotation(seed: int = 0) -> NDArray[np.float64]:
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3))).Q
    return q * np.linalg.det(q)


@each_case("mesh", DEFORMED)
def test_edges_go_to_edges(mesh: TriangleMesh) -> None:
    verts = noise(mesh)
    for jacobians in (
        jacobians_from_verts(RestMesh.of(mesh).gradient, verts),
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
        jacobians_from_verts(RestMesh.of(mesh).gradient, verts[1:])
    normals = face_normals(mesh.verts, mesh.faces)[:, :, None]
    plain = jacobians_from_verts(RestMesh.of(mesh).gradient, verts)
    assert float(np.abs(plain @ normals).max()) < 1e-13
    stretch = np.sqrt(face_areas(verts, mesh.faces) / face_areas(mesh.verts, mesh.faces))
    moved = (completed_jacobians(mesh, verts) @ normals)[:, :, 0]
    assert_close(moved, stretch[:, None] * face_normals(verts, mesh.faces), atol=1e-12, rtol=0)


@each_case("mesh", DEFORMED)
def test_a_similarity_is_itself_on_every_face(mesh: TriangleMesh) -> None:
    similarity = 2.5 * rotation()
    found = completed_jacobians(mesh, mesh.verts @ similarity.T + 7)
    assert_close(found, np.broadcast_to(similarity, found.shape), atol=1e-12, rtol=0)


def test_collapsed_faces_are_finite_before_and_after() -> None:
    verts = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], np.float64)
    faces = np.array([[0, 1, 2], [0, 1, 3]])
    found = completed_jacobians(TriangleMesh(verts, faces), verts * np.array([1.0, 0.0, 1.0], np.float64))
    assert np.array_equal(found[0], np.eye(3))
    assert_close(found[1], np.diag([1.0, 0.0, 0.0]))
