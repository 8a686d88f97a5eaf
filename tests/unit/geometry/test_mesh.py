"""Edges, areas, normals and components of good meshes and of triangle soups."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.errors import ShapeError
from meshdeform.geometry import COLLAPSED_SHAPE, tensors
from meshdeform.geometry.interpolation import interpolate
from meshdeform.geometry.mesh import (
    RestMesh,
    TriangleMesh,
    connected_components,
    edges_of,
    face_areas,
    face_normals,
)
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from tests.close import assert_close
from training.shapes import box, grid, torus, uv_sphere


@each_case(
    ("verts", "faces"),
    [
        (np.zeros((3, 3), np.float32), np.zeros((1, 3), np.int64)),
        (np.zeros((3, 2)), np.zeros((1, 3), np.int64)),
        (np.zeros((3, 3)), np.zeros((1, 3), np.int32)),
        (np.zeros((3, 3)), np.array([[0, 1, 3]])),
        (np.zeros((3, 3)), np.array([[0, 1, -1]])),
    ],
)
def test_what_is_no_mesh_is_refused(verts: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    with pytest.raises(ShapeError):
        TriangleMesh(verts, faces)


@each_case(("mesh", "characteristic"), [(icosphere(2), 2), (torus(), 0), (grid(4), 1)])
def test_edges_satisfy_eulers_formula(mesh: TriangleMesh, characteristic: int) -> None:
    edges = edges_of(mesh.faces)
    assert mesh.verts.shape[0] - edges.edges.shape[0] + mesh.faces.shape[0] == characteristic
    assert int(edges.counts.sum()) == 3 * mesh.faces.shape[0]


def test_each_edge_knows_its_faces() -> None:
    mesh = icosphere(1)
    edges = edges_of(mesh.faces)
    assert bool(edges.consistent.all())
    for side in (0, 1):
        corners = np.sort(np.concatenate([edges.edges, edges.opposite[:, side : side + 1]], 1), axis=1)
        assert np.array_equal(corners, np.sort(mesh.faces[edges.faces[:, side]], axis=1))
    edges = edges_of(np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    assert edges.edges[0].tolist() == [0, 1]
    assert edges.counts.tolist() == [3, 1, 1, 1, 1, 1, 1]
    assert edges.faces[0].tolist() == [0, 1]
    assert edges.faces[1:, 1].tolist() == [-1] * 6
    assert edges.opposite[1:, 1].tolist() == [-1] * 6
    assert edges.consistent.tolist() == [True] + [False] * 6
    # Neighbours that are wound against each other.
    assert not bool(edges_of(np.array([[0, 1, 2], [0, 1, 3]])).consistent.any())
    edges = edges_of(np.zeros((0, 3), np.int64))
    assert edges.edges.shape == edges.faces.shape == edges.opposite.shape == (0, 2)
    assert edges.counts.shape == edges.consistent.shape == (0,)


def test_areas_and_normals_of_faces() -> None:
    verts = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 1], [1, 1, 2]])
    assert face_areas(verts, faces).tolist() == [3.0, 3.0, 0.0]
    assert face_normals(verts, faces).tolist() == [[0, 0, 1], [0, 0, -1], [0, 0, 0]]
    mesh = icosphere(2)
    given = tensors.verts_of(mesh), tensors.faces_of(mesh)
    assert_close(tensors.face_areas(*given), face_areas(mesh.verts, mesh.faces), rtol=1e-14, atol=0)
    assert_close(tensors.face_normals(*given), face_normals(mesh.verts, mesh.faces), rtol=0, atol=1e-15)


def test_collapsed_faces_have_zero_normals_and_zero_gradients() -> None:
    verts = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0]], dtype=torch.float64).requires_grad_()
    faces = torch.tensor([[0, 1, 2], [0, 3, 0]])
    (tensors.face_normals(verts, faces).sum() + tensors.face_areas(verts, faces).sum()).backward()
    assert tensors.face_normals(verts, faces).abs().max() == 0
    assert verts.grad is not None
    assert verts.grad.abs().max() == 0
    vectors = torch.randn(5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    assert_close(tensors.safe_normalize(vectors).norm(dim=1), torch.ones(5, dtype=torch.float64))
    assert torch.autograd.gradcheck(tensors.safe_normalize, (vectors,))


def test_components_are_what_faces_connect() -> None:
    mesh = join(icosphere(0), torus(n=4, m=3), grid(1))
    labels = connected_components(mesh.faces, mesh.verts.shape[0] + 2)
    assert np.bincount(labels).tolist() == [12, 12, 4, 1, 1]
    assert bool((labels[mesh.faces] == labels[mesh.faces[:, :1]]).all())


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(*[st.integers(0, 7)] * 3), max_size=20))
def test_any_soup_has_edges(rows: list[tuple[int, int, int]]) -> None:
    faces = np.array(rows, np.int64).reshape(-1, 3)
    edges = edges_of(faces)
    assert int(edges.counts.sum()) == 3 * len(rows)
    assert bool(((edges.counts > 1) == (edges.faces[:, 1] >= 0)).all())


# Identities that hold between the operators, and one triangle by hand.


MESHES = [icosphere(2), box(2), grid(4), torus(n=12, m=8), uv_sphere(6, 8), join(icosphere(0), grid(1))]


def mesh_of(verts: list[list[float]], faces: list[list[int]]) -> TriangleMesh:
    return TriangleMesh(np.array(verts, np.float64), np.array(faces, np.int64).reshape(-1, 3))


@each_case("mesh", MESHES)
def test_the_operators_agree(mesh: TriangleMesh) -> None:
    rest = RestMesh.of(mesh)
    gradient = rest.gradient
    product = gradient.T @ sparse.diags(np.repeat(rest.areas, 3)) @ gradient
    np.testing.assert_allclose(rest.laplacian.toarray(), product.toarray(), atol=1e-12)
    assert rest.vertex_areas.sum() == pytest.approx(rest.areas.sum())
    # The gradient of a linear function is the part of its slope that lies in the face.
    slope, normal = np.array([0.3, -1.2, 0.7]), face_normals(mesh.verts, mesh.faces)
    found = (gradient @ (mesh.verts @ slope)).reshape(-1, 3)
    np.testing.assert_allclose(found, slope - (normal @ slope)[:, None] * normal, atol=1e-12)


def test_the_laplacian_has_the_cotangents() -> None:
    """A triangle of 90, 60 and 30 degrees: entries are minus half the opposite angle's cotangent."""
    mesh = mesh_of([[0, 0, 0], [1, 0, 0], [0, 3**0.5, 0]], [[0, 1, 2]])
    half_cot = {(1, 2): 0.0, (0, 2): 0.5 / 3**0.5, (0, 1): 0.5 * 3**0.5}
    laplacian = RestMesh.of(mesh).laplacian.toarray()
    for (i, j), value in half_cot.items():
        assert laplacian[i, j] == pytest.approx(-value, abs=1e-15)
    assert laplacian[0, 0] == pytest.approx(half_cot[0, 1] + half_cot[0, 2])


@each_case("unit", [1e-9, 1.0, 1e9])
def test_collapse_is_a_matter_of_shape_not_of_size(unit: float) -> None:
    thin, good = 0.5 * COLLAPSED_SHAPE, 10 * COLLAPSED_SHAPE
    verts = np.array([[0, 0, 0], [1, 0, 0], [0.5, 2 * thin, 0], [0.5, 2 * good, 0]]) * unit
    mesh = mesh_of(verts.tolist(), [[0, 1, 2], [0, 1, 3], [0, 0, 1], [1, 1, 1]])
    assert RestMesh.of(mesh).solid.tolist() == [False, True, False, False]


def test_collapsed_faces_keep_the_derivative_along_their_edge() -> None:
    mesh = RestMesh.of(mesh_of([[0, 0, 0], [2, 0, 0], [1, 0, 0]], [[0, 1, 2], [1, 1, 1]]))
    gradient = (mesh.gradient @ np.array([1.0, 5.0, 77.0])).reshape(-1, 3)
    assert gradient.tolist() == [[2, 0, 0], [0, 0, 0]]
    assert np.isfinite(mesh.gradient.data).all()
    assert abs(mesh.laplacian).sum() == 0
    empty = RestMesh.of(mesh_of([[0, 0, 0], [1, 0, 0]], []))
    assert empty.gradient.shape == (0, 2)
    assert empty.laplacian.shape == (2, 2)
    assert empty.vertex_areas.tolist() == [0, 0]


def test_the_sparse_product_has_the_transposed_as_its_gradient() -> None:
    matrix = sparse.random(6, 4, 0.5, format="csr", random_state=0, dtype=np.float64)
    dense = torch.randn(4, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    np.testing.assert_allclose(
        tensors.sparse_product(matrix, dense).detach().numpy(), matrix.toarray() @ dense.detach().numpy()
    )
    assert torch.autograd.gradcheck(lambda x: tensors.sparse_product(matrix, x), (dense,))


# Interpolation between scattered points by inverse squared distance, against values by hand.


POINTS = np.array([[0.0, 0, 0], [3.0, 0, 0], [100.0, 0, 0], [200.0, 0, 0], [0, 5000.0, 0]])
VALUES = np.array([[1.0], [2.0], [0.0], [0.0], [1e9]])


def test_scattered_values_are_weighted_by_inverse_squared_distances_of_the_four_nearest() -> None:
    weights = 1 / np.array([1.0, 2.0, 99.0, 199.0]) ** 2
    expected = (weights * [1, 2, 0, 0]).sum() / weights.sum()
    np.testing.assert_allclose(interpolate(POINTS, VALUES, np.array([[1.0, 0, 0]])), [[expected]], rtol=1e-12)
    np.testing.assert_array_equal(interpolate(POINTS, VALUES, POINTS), VALUES)
    doubled = np.concatenate([POINTS[:1], POINTS])
    np.testing.assert_array_equal(interpolate(doubled, np.concatenate([[[3.0]], VALUES]), POINTS[:1]), [[2.0]])
    np.testing.assert_array_equal(interpolate(POINTS[:1], VALUES[:1], POINTS + 7), np.ones((5, 1)))
