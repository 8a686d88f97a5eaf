"""Normals and tangents of the source are carried, not recomputed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.deformation.jacobians import completed_jacobians
from meshdeform.geometry.mesh import RestMesh, TriangleMesh, face_cross
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.weld import weld
from meshdeform.runs.surfaces import rebuild_turned_normals, transform_normals, transform_tangents
from tests.cases import each_case
from training.shapes import box, torus


def unit(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def rotation() -> NDArray[np.float64]:
    q, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return q * np.linalg.det(q)


def carried(
    mesh: TriangleMesh,
    new: NDArray[np.float64],
    normals: NDArray[np.float64],
    triangles: NDArray[np.int64] | None = None,
) -> NDArray[np.float64]:
    jacobians = completed_jacobians(mesh, new)
    corners = mesh.faces if triangles is None else triangles
    return transform_normals(normals, corners, jacobians, RestMesh.of(mesh).areas)


def smooth_map(verts: NDArray[np.float64]) -> NDArray[np.float64]:
    return verts * np.array([1.0, 1.5, 0.7]) + 0.1 * np.sin(3 * verts[:, ::-1])


@each_case("mesh", [icosphere(2), torus(), box(3)])
def test_no_deformation_gives_the_same_float32_bits(mesh: TriangleMesh) -> None:
    normals = unit(np.random.default_rng(0).normal(size=mesh.verts.shape)).astype(np.float32)
    found = carried(mesh, mesh.verts.copy(), normals.astype(np.float64))
    assert np.array_equal(found.astype(np.float32), normals)


def test_the_true_normals_of_an_ellipsoid_come_out() -> None:
    """A sphere's normals under x -> A x become those of the ellipsoid, A^-T n: what recomputing only approximates."""
    mesh = icosphere(4)
    stretch = np.array([1.0, 2.0, 0.5])
    found = carried(mesh, mesh.verts * stretch, mesh.verts)
    true = unit(mesh.verts / stretch)
    assert np.degrees(np.arccos(np.clip((found * true).sum(1), -1, 1))).max() < 1.0


def test_hard_edges_stay_hard() -> None:
    """A box that is exported with flat sides is twisted: both normals at an edge follow their own side."""
    solid = box(4)
    positions = solid.verts[solid.faces].reshape(-1, 3)
    triangles = np.arange(len(positions)).reshape(-1, 3)
    cross = np.cross(positions[1::3] - positions[::3], positions[2::3] - positions[::3])
    welded = weld(positions, triangles)
    angle = welded.mesh.verts[:, 1] * 0.6
    x, y, z = welded.mesh.verts.T
    twisted = np.stack([x * np.cos(angle) - z * np.sin(angle), y, x * np.sin(angle) + z * np.cos(angle)], 1)
    found = carried(welded.mesh, twisted, unit(np.repeat(cross, 3, axis=0)), triangles[welded.face_source])
    moved = welded.scatter(twisted, positions)
    face = np.cross(moved[1::3] - moved[::3], moved[2::3] - moved[::3])
    np.testing.assert_allclose(found, unit(np.repeat(face, 3, axis=0)), atol=1e-12)


def test_missing_normals_stay_missing_and_unused_vertices_keep_theirs() -> None:
    ball = icosphere(1)
    mesh = TriangleMesh(np.concatenate([ball.verts, np.ones((1, 3))]), ball.faces)
    normals = np.concatenate([unit(ball.verts), [[0.0, 1.0, 0.0]]])
    normals[3] = np.nan
    found = carried(mesh, smooth_map(mesh.verts), normals)
    assert np.isnan(found[3]).all()
    assert np.isfinite(np.delete(found, 3, axis=0)).all()
    assert found[-1].tolist() == [0, 1, 0]


def test_faces_that_collapse_have_no_say() -> None:
    mesh = icosphere(1)
    normals = mesh.verts
    assert np.array_equal(carried(mesh, np.zeros_like(mesh.verts), normals), normals)
    pinched = smooth_map(mesh.verts)
    pinched[mesh.faces[0]] = pinched[mesh.faces[0, 0]].copy()
    found = carried(mesh, pinched, normals)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-9)


def tangents_of(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Unit tangents around the Y axis, handedness alternating."""
    around = np.cross([0.0, 1.0, 0.0], mesh.verts + [1e-3, 0, 2e-3])
    normals = mesh.verts
    flat = unit(around - (around * normals).sum(1, keepdims=True) * normals)
    return np.concatenate([flat, np.where(np.arange(len(flat)) % 2, 1.0, -1.0)[:, None]], 1)


def test_tangents_are_carried_perpendicular_with_their_handedness() -> None:
    mesh = icosphere(3)
    new, tangents = smooth_map(mesh.verts), tangents_of(mesh)
    jacobians = completed_jacobians(mesh, new)
    areas = RestMesh.of(mesh).areas
    corners = mesh.faces
    normals = transform_normals(mesh.verts, corners, jacobians, areas)
    found = transform_tangents(tangents, normals, corners, jacobians, areas)
    assert np.array_equal(found[:, 3], tangents[:, 3])
    np.testing.assert_allclose((found[:, :3] * normals).sum(1), 0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), 1, atol=1e-9)
    # To first order a tangent goes where its end point goes.
    step = 1e-5
    ends = smooth_map(mesh.verts + step * tangents[:, :3]) - new
    assert ((unit(ends) * found[:, :3]).sum(1) > 0.99).all()
    # Without a deformation they stay, and missing ones stay missing.
    tangents[5] = np.nan
    still = completed_jacobians(mesh, mesh.verts)
    for normals in (mesh.verts, np.full(mesh.verts.shape, np.nan)):
        found = transform_tangents(tangents, normals, corners, still, areas)
        np.testing.assert_allclose(found, tangents, atol=1e-12)


def test_a_normal_that_would_point_behind_a_face_is_rebuilt() -> None:
    """A ridge whose normal leans to one side; its small other side is turned steep, against the lean."""
    verts = np.array([[0.0, 0, 0], [0, 1, 0], [-3, 0.5, -0.2], [0.3, 0.5, -0.2]])
    mesh = TriangleMesh(verts, np.array([[0, 1, 2], [1, 0, 3]]))
    normals = unit(np.array([[-0.3, 0, 1.0]] * 4))
    new = verts.copy()
    new[3] = np.array([-0.3, 0.5, -0.9])  # folds under, beyond the vertical
    moved = carried(mesh, new, normals)
    faces = face_cross(mesh.verts, mesh.faces), face_cross(new, mesh.faces)
    after = unit(faces[1])
    assert (after[1] @ moved[0]) < 0, "the ridge's normal points behind the folded side"
    rebuilt, count = rebuild_turned_normals(moved, normals, mesh.faces, *faces)
    assert count >= 2
    np.testing.assert_allclose(rebuilt[0], unit(faces[1].sum(0, keepdims=True))[0], atol=1e-12)
    # With the winding turned around, the same vertices and the same normals up to their sign.
    back = mesh.faces[:, ::-1]
    mirrored, again = rebuild_turned_normals(moved, normals, back, -faces[0], -faces[1])
    assert again == count
    np.testing.assert_allclose(mirrored, rebuilt, atol=1e-12)


def test_normals_that_keep_their_sides_and_missing_ones_stay() -> None:
    mesh = icosphere(2)
    normals = mesh.verts.copy()
    normals[5] = np.nan
    new = smooth_map(mesh.verts)
    moved = carried(mesh, new, normals)
    faces = face_cross(mesh.verts, mesh.faces), face_cross(new, mesh.faces)
    rebuilt, count = rebuild_turned_normals(moved, normals, mesh.faces, *faces)
    assert count == 0
    np.testing.assert_array_equal(rebuilt, moved)
