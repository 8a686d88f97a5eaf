"""Identities that hold between the operators, and one triangle by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy import sparse

from meshdeform.geometry.mesh import (
    COLLAPSED_SHAPE,
    TriangleMesh,
    cotangent_laplacian,
    effective_face_areas,
    face_normals,
    gradient_operator,
    mass_matrix,
    sparse_product,
    vertex_areas,
)
from meshdeform.geometry.shapes import box, grid, icosphere, join, torus, uv_sphere
from tests.cases import each_case

MESHES = [icosphere(2), box(2), grid(4), torus(n=12, m=8), uv_sphere(6, 8), join(icosphere(0), grid(1))]


def mesh_of(verts: list[list[float]], faces: list[list[int]]) -> TriangleMesh:
    return TriangleMesh(torch.tensor(verts, dtype=torch.float64), torch.tensor(faces, dtype=torch.int64).reshape(-1, 3))


@each_case("mesh", MESHES)
def test_the_laplacian_is_g_transposed_m_g(mesh: TriangleMesh) -> None:
    gradient = gradient_operator(mesh).toarray()
    product = gradient.T @ mass_matrix(mesh).toarray() @ gradient
    np.testing.assert_allclose(cotangent_laplacian(mesh).toarray(), product, atol=1e-12)


@each_case("mesh", MESHES)
def test_the_laplacian_is_symmetric_and_semi_definite_with_constants_in_its_kernel(mesh: TriangleMesh) -> None:
    laplacian = cotangent_laplacian(mesh).toarray()
    np.testing.assert_allclose(laplacian, laplacian.T, atol=1e-13)
    np.testing.assert_allclose(laplacian @ np.ones(len(laplacian)), 0, atol=1e-12)
    eigenvalues = np.linalg.eigvalsh(laplacian)
    assert eigenvalues.min() > -1e-12


def test_the_laplacian_has_the_cotangents() -> None:
    """A triangle of 90, 60 and 30 degrees: entries are minus half the opposite angle's cotangent."""
    mesh = mesh_of([[0, 0, 0], [1, 0, 0], [0, 3**0.5, 0]], [[0, 1, 2]])
    half_cot = {(1, 2): 0.0, (0, 2): 0.5 / 3**0.5, (0, 1): 0.5 * 3**0.5}
    laplacian = cotangent_laplacian(mesh).toarray()
    for (i, j), value in half_cot.items():
        assert laplacian[i, j] == pytest.approx(-value, abs=1e-15)
    assert laplacian[0, 0] == pytest.approx(half_cot[0, 1] + half_cot[0, 2])


@each_case("mesh", MESHES)
def test_the_gradient_of_a_linear_function_is_its_tangential_part(mesh: TriangleMesh) -> None:
    slope = np.array([0.3, -1.2, 0.7])
    found = (gradient_operator(mesh) @ (mesh.verts.numpy() @ slope)).reshape(-1, 3)
    normal = face_normals(mesh.verts, mesh.faces).numpy()
    np.testing.assert_allclose(found, slope - (normal @ slope)[:, None] * normal, atol=1e-12)


def test_the_laplacian_does_not_know_the_unit() -> None:
    mesh = icosphere(1)
    large = TriangleMesh(mesh.verts * 1e6, mesh.faces)
    np.testing.assert_allclose(
        cotangent_laplacian(large).toarray(), cotangent_laplacian(mesh).toarray(), rtol=1e-10, atol=1e-13
    )


@each_case("mesh", MESHES)
def test_vertex_areas_sum_to_the_surface(mesh: TriangleMesh) -> None:
    assert vertex_areas(mesh).sum() == pytest.approx(effective_face_areas(mesh).sum())


@each_case("unit", [1e-9, 1.0, 1e9])
def test_collapse_is_a_matter_of_shape_not_of_size(unit: float) -> None:
    thin, good = 0.5 * COLLAPSED_SHAPE, 10 * COLLAPSED_SHAPE
    verts = np.array([[0, 0, 0], [1, 0, 0], [0.5, 2 * thin, 0], [0.5, 2 * good, 0]]) * unit
    mesh = mesh_of(verts.tolist(), [[0, 1, 2], [0, 1, 3], [0, 0, 1], [1, 1, 1]])
    assert (effective_face_areas(mesh) > 0).tolist() == [False, True, False, False]


def test_collapsed_faces_keep_the_derivative_along_their_edge() -> None:
    mesh = mesh_of([[0, 0, 0], [2, 0, 0], [1, 0, 0]], [[0, 1, 2], [1, 1, 1]])
    gradient = (gradient_operator(mesh) @ np.array([1.0, 5.0, 77.0])).reshape(-1, 3)
    assert gradient.tolist() == [[2, 0, 0], [0, 0, 0]]
    assert np.isfinite(gradient_operator(mesh).data).all()
    assert abs(cotangent_laplacian(mesh)).sum() == 0


def test_a_mesh_without_faces_has_empty_operators() -> None:
    mesh = mesh_of([[0, 0, 0], [1, 0, 0]], [])
    assert gradient_operator(mesh).shape == (0, 2)
    assert cotangent_laplacian(mesh).shape == (2, 2)
    assert vertex_areas(mesh).tolist() == [0, 0]


def test_the_sparse_product_has_the_transposed_as_its_gradient() -> None:
    matrix = sparse.random(6, 4, 0.5, format="csr", random_state=0, dtype=np.float64)
    dense = torch.randn(4, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    np.testing.assert_allclose(
        sparse_product(matrix, dense).detach().numpy(), matrix.toarray() @ dense.detach().numpy()
    )
    assert torch.autograd.gradcheck(lambda x: sparse_product(matrix, x), (dense,))
