"""Flips, spectra and geodesics, with a plane and spheres as known answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

from meshdeform.fields.intrinsic import areas_of, delaunay, half_cotangents
from meshdeform.fields.intrinsic_operators import HeatGeodesics, laplacian, mass, spectrum
from meshdeform.geometry.shapes import grid, icosphere, join


def test_flips_in_a_plane_give_the_delaunay_triangulation() -> None:
    random = np.random.default_rng(3)
    mesh = grid(12)
    verts, faces = mesh.verts.numpy().copy(), mesh.faces.numpy()
    inner = (np.abs(verts[:, :2]) < 0.49).all(1)
    verts[inner, :2] += random.uniform(-0.035, 0.035, (int(inner.sum()), 2))
    before = delaunay(verts, faces)
    assert before.flips > 20
    assert before.certified
    assert areas_of(before.lengths).sum() == pytest.approx(1.0)
    wanted = {tuple(sorted(face)) for face in Delaunay(verts[:, :2]).simplices.tolist()}
    found = {tuple(sorted(face)) for face in before.faces.tolist()}
    # Along the straight border scipy adds or leaves out triangles without area.
    assert len(found & wanted) >= len(found) - 4
    places = verts[before.faces]
    assert before.lengths == pytest.approx(np.linalg.norm(np.roll(places, -1, 1) - places, axis=2), rel=1e-5)


def test_a_stretched_sphere_is_delaunay_after_flips_and_before_it_is_not() -> None:
    mesh = icosphere(3)
    verts = mesh.verts.numpy() * [1.0, 1.0, 6.0]
    sides = np.linalg.norm(np.roll(verts[mesh.faces.numpy()], -1, 1) - verts[mesh.faces.numpy()], axis=2)
    assert half_cotangents(sides).min() < -0.5
    found = delaunay(verts, mesh.faces.numpy())
    assert found.flips > 100
    assert found.least > -1e-6
    matrix = laplacian(found)
    assert np.abs(matrix.sum(1)).max() < 1e-9
    # All weights of a Delaunay Laplacian are positive, so a maximum lies at a source.
    assert (matrix - np.diag(matrix.diagonal())).max() < 1e-6


def test_the_spectrum_of_a_sphere_is_l_times_l_plus_one() -> None:
    mesh = icosphere(4)
    found = delaunay(mesh.verts.numpy(), mesh.faces.numpy())
    values, functions = spectrum(found, 16)
    known = [0.0] + [2.0] * 3 + [6.0] * 5 + [12.0] * 7
    assert values == pytest.approx(known, rel=0.005, abs=1e-6)
    gram = functions.T @ (mass(found)[:, None] * functions)
    assert np.abs(gram - np.eye(16)).max() < 1e-6


def test_geodesics_on_a_sphere_are_angles_and_other_parts_are_infinitely_far() -> None:
    mesh = icosphere(4)
    both = join(mesh, icosphere(0))
    found = HeatGeodesics(delaunay(both.verts.numpy(), both.faces.numpy())).distances([0])
    angles = np.arccos(np.clip(mesh.verts.numpy() @ mesh.verts.numpy()[0], -1, 1))
    assert np.abs(found[: len(angles)] - angles).max() < 0.05
    assert np.isinf(found[len(angles) :]).all()


def uneven_sphere() -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere with most of its vertices in a small cap, as a base has them where a surface bends."""
    random = np.random.default_rng(0)
    around, height = random.uniform(0, 2 * np.pi, 4000), random.uniform(0.98, 1.0, 4000)
    cap = np.stack([np.cos(around), np.sin(around), height], 1)
    cap[:, :2] *= np.sqrt(1 - height**2)[:, None]
    verts = np.concatenate([icosphere(3).verts.numpy(), cap])
    faces = ConvexHull(verts).simplices.astype(np.int64)
    corners = verts[faces]
    inside = (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * corners.sum(1)).sum(1) < 0
    faces[inside] = faces[inside][:, ::-1]
    return verts, faces


def test_geodesics_do_not_depend_on_where_the_triangles_are_small() -> None:
    verts, faces = uneven_sphere()
    found = HeatGeodesics(delaunay(verts, faces)).distances([3000])
    angles = np.arccos(np.clip(verts @ verts[3000], -1, 1))
    assert np.abs(found - angles).mean() < 0.015 * angles.mean()  # 0.040 with a time from the mean over the edges
