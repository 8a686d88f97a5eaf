"""Cleaning, bases and extraction: what is one surface stays one, with its handles."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

from meshdeform.errors import AssetError, AssetTooLargeError
from meshdeform.geometry.edge_splits import unique_edges
from meshdeform.geometry.isosurface import isosurface
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.kinds.surface_fit.base_places import border_places
from meshdeform.kinds.surface_fit.cleaning import CleanMesh, clean
from meshdeform.kinds.surface_fit.collapse import base_of, collapsed
from meshdeform.kinds.surface_fit.container import encode_base
from meshdeform.kinds.surface_fit.gluing import glue, topology
from meshdeform.kinds.surface_fit.intrinsic import (
    HeatGeodesics,
    areas_of,
    delaunay,
    mass,
    spectrum,
)
from meshdeform.kinds.surface_fit.measures import EIGENVALUES, Reference
from meshdeform.kinds.surface_fit.patches import divided, level_of
from meshdeform.kinds.surface_fit.surface_files import DistanceGrid, OrientedPoints
from meshdeform.kinds.surface_fit.surface_sources import surface_of
from training.shapes import box, grid, torus


def arrays(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    return mesh.verts, mesh.faces


def lattice(cells: int, reach: float) -> np.ndarray:
    axis = np.linspace(-reach, reach, cells)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)


def ring(at: np.ndarray, major: float = 0.9, minor: float = 0.35) -> np.ndarray:
    """Return the signed distance from a torus around the z axis."""
    return np.hypot(np.hypot(at[..., 0], at[..., 1]) - major, at[..., 2]) - minor


def volume(verts: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = verts[faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


def test_solids_that_touch_along_an_edge_are_separated() -> None:
    one, other = box(1), box(1)
    other = TriangleMesh(other.verts + np.array([1.0, 1.0, 0.0]), other.faces)
    found = clean(*arrays(join(one, other)))
    assert found.topology.characteristics == (2, 2)
    assert found.topology.border_edges == 0
    assert found.cleaned["non_manifold_edges"] == 1
    assert found.cleaned["separated_vertices"] == 2


def test_faces_that_are_turned_to_opposite_sides_are_turned_to_the_outside() -> None:
    ball, ring = icosphere(1), torus(n=12, m=8)
    shell = TriangleMesh(ball.verts + 3.0, ball.faces[:40])
    verts, faces = arrays(join(ball, shell, TriangleMesh(ring.verts - 9.0, ring.faces[:, ::-1])))
    turned = faces.copy()
    turned[:120:3] = turned[:120:3, ::-1]
    found = clean(verts, turned)
    assert found.cleaned["turned_faces"] == 40
    assert found.cleaned["reversed_edges"] == 0
    assert found.topology == clean(verts, faces).topology
    closed = found.faces[(found.verts[found.faces] ** 2).sum(2).max(1) < 1.1]
    assert volume(found.verts, closed) > 0
    # A surface that agrees with itself stays as it is, inside out or not.
    last = found.faces[(found.verts[found.faces] < -5).all((1, 2))]
    assert volume(found.verts + 9.0, last) < 0


def test_a_surface_with_one_side_and_a_heap_of_parts_are_refused() -> None:
    at = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    across = 0.3 * np.stack([np.cos(at / 2) * np.cos(at), np.cos(at / 2) * np.sin(at), np.sin(at / 2)], 1)
    middle = np.stack([np.cos(at), np.sin(at), 0 * at], 1)
    strip = np.concatenate([middle - across, middle + across])
    i = np.arange(24)
    ahead = [np.where(i < 23, i + 1 + k, 24 - k) for k in (0, 24)]
    quads = np.stack([i, ahead[0], ahead[1], i + 24], 1)
    moebius = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    # One edge in a hundred may be a border instead.
    with pytest.raises(AssetError, match="opposite sides"):
        clean(strip, moebius)
    tetrahedron = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    many = 65
    with pytest.raises(AssetError, match="65 separate parts"):
        clean(
            np.concatenate([tetrahedron + [3 * i, 0, 0] for i in range(many)]),
            np.concatenate([sides + 4 * i for i in range(many)]),
        )


def test_a_base_has_the_handles_and_borders_of_the_surface() -> None:
    holed = grid(30)
    middle = np.abs(holed.verts[holed.faces].mean(1)[:, :2]).max(1) < 0.1
    cases = ((torus(), 1, 0), (join(torus(), icosphere(3)), 1, 0), (grid(30), 0, 1))
    for mesh, genus, borders in (*cases, (TriangleMesh(holed.verts, holed.faces[~middle]), 0, 2)):
        surface = clean(*arrays(mesh))
        for count in (150, 40):
            verts, faces = base_of(surface, count)
            found = topology(faces, glue(verts, faces))
            assert count - 2 <= len(faces) <= count
            assert (found.genus, found.borders) == (genus, borders)
            assert found.characteristics == surface.topology.characteristics
            # The corners of a border stay where they are, and its sides straight.
            rim = np.abs(verts[np.unique(border_places(verts, faces, glue(verts, faces), 999)[0][:, :2]), :2]).max(1)
            assert rim[rim > 0.3] == pytest.approx(0.5, abs=1e-3)
    # Nothing can be taken from a tetrahedron, nor from a triangle.
    tetrahedron = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    for faces, least in ((sides, 4), (sides[:3], 1)):
        twin = glue(tetrahedron, faces)
        assert len(collapsed(CleanMesh(tetrahedron, faces, twin, topology(faces, twin), {}), 0)[1]) == least


def test_a_surface_that_touches_itself_along_an_edge_has_a_base_of_unique_edges() -> None:
    # Two cubes that share an edge, between two layers that join them at both its ends.
    cubes = {(0, 0, 1), (1, 1, 1), *((x, y, z) for z in (0, 2) for x, y in ((0, 0), (1, 0), (1, 1)))}
    quads = []
    for cube in cubes:
        for axis, side in itertools.product(range(3), (0, 1)):
            step = np.eye(3, dtype=int)[axis]
            if tuple(int(x) for x in np.array(cube) + (2 * side - 1) * step) not in cubes:
                one, other = np.roll(np.eye(3, dtype=int), -1 - axis, 0)[:2]
                square = np.array([0 * one, one, one + other, other]) + side * step + cube
                quads.append(square if side else square[::-1])
    verts = np.concatenate(quads).astype(np.float64)
    faces = np.concatenate([np.arange(4 * len(quads)).reshape(-1, 4)[:, part] for part in ([0, 1, 2], [0, 2, 3])])
    surface = clean(verts, faces)
    assert surface.cleaned["non_manifold_edges"] == 1
    for count in (1000, 40):
        verts, faces = base_of(surface, count)
        found = topology(faces, glue(verts, faces))
        assert found == surface.topology
        assert np.bincount(unique_edges(faces)[1].ravel()).max() == 2
        assert len(faces) <= count
        encode_base((verts - 1.5) / 3, faces)
    assert volume(*base_of(surface, 1000)) == pytest.approx(8)


def test_a_level_is_one_mesh_whose_points_lie_in_the_base() -> None:
    verts, faces = arrays(torus(n=6, m=4))
    for level in (0, 1, 3):
        found = level_of(faces, len(verts), level)
        points = np.einsum("pk,pkc->pc", found.weights, verts[found.corners])
        assert len(found.faces) == len(faces) * 4**level
        assert len(np.unique(points.round(9), axis=0)) == len(points)
        assert volume(points, found.faces) == pytest.approx(volume(verts, faces))
        assert topology(found.faces, glue(points, found.faces)).genus == 1


def test_a_distance_grid_becomes_its_torus() -> None:
    reach, cells = 1.4, 28
    at = lattice(cells, reach)
    spacing = 2 * reach / (cells - 1)
    verts, faces = isosurface(ring(at), np.full(3, -reach), np.full(3, spacing))
    found = topology(faces, glue(verts, faces))
    assert (found.components, found.genus) == (1, 1)
    assert volume(verts, faces) == pytest.approx(2 * np.pi**2 * 0.9 * 0.35**2, rel=0.05)
    surface = surface_of(DistanceGrid(ring(at), np.full(3, -reach), np.full(3, spacing)))
    place, normal = surface.project(np.array([[1.4, 0.0, 0.1], [0.0, 0.5, 0.0]]), np.zeros((2, 3)))
    assert np.abs(ring(place)).max() < 0.01
    assert normal[1] == pytest.approx([0, -1, 0], abs=0.05)


def test_noisy_points_become_a_closed_surface_within_the_noise() -> None:
    random = np.random.default_rng(0)
    normals = random.normal(size=(1500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = OrientedPoints(normals * (1 + 0.01 * random.normal(size=(1500, 1))), normals)
    surface = surface_of(cloud)
    assert surface.reference.topology.genus == 0
    assert np.abs(np.linalg.norm(surface.reference.verts, axis=1) - 1).max() < 0.03
    place, normal = surface.project(np.array([[0.0, 0.0, 1.1]]), np.array([[0.0, 0.0, 1.0]]))
    assert np.linalg.norm(place) == pytest.approx(1, abs=0.02)
    assert normal[0, 2] > 0.98
    # A stray point does not make the rest coarse.
    verts, _ = arrays(icosphere(4))
    points = np.concatenate([verts, [[50.0, 0.0, 0.0], [0.0, 70.0, 0.0]]])
    normals = np.concatenate([verts, [[1.0, 0.0, 0.0]] * 2])
    found = surface_of(OrientedPoints(points, normals)).reference
    assert found.cleaned["stray_points"] == 2
    assert np.linalg.norm(found.verts, axis=1) == pytest.approx(1, abs=0.02)
    # Many of them are a part of the surface.
    apart = np.concatenate([verts, verts + [9, 0, 0]])
    both = surface_of(OrientedPoints(apart, np.concatenate([verts, verts]))).reference
    assert (both.cleaned["stray_points"], both.topology.components) == (0, 2)


def test_points_keep_thin_parts_and_open_sides_and_normals_to_the_inside_are_turned() -> None:
    random = np.random.default_rng(0)
    ball = random.normal(size=(8000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    # A tube on top, a sixteenth as thick as the ball.
    turn, height = random.uniform(0, 2 * np.pi, 1500), random.uniform(1, 2, 1500)
    around = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    tube = np.concatenate([0.06 * around[:, :2], height[:, None]], 1)
    outer = ball[(np.hypot(ball[:, 0], ball[:, 1]) > 0.06) | (ball[:, 2] < 0)]
    points, normals = np.concatenate([outer, tube]), np.concatenate([outer, around])
    for facing in (1, -1):
        found = surface_of(OrientedPoints(points, facing * normals))
        assert found.reference.topology.characteristics == (2,)
        assert found.reference.verts[:, 2].max() == pytest.approx(2, abs=0.03)
        assert found.reference.cleaned["turned_normals"] == (len(points) if facing < 0 else 0)
        assert volume(found.reference.verts, found.reference.faces) == pytest.approx(4 / 3 * np.pi, rel=0.02)
    low = ball[ball[:, 2] < 0.3]
    bowl = surface_of(OrientedPoints(low, low)).reference
    assert (bowl.topology.characteristics, bowl.topology.borders) == ((1,), 1)
    assert bowl.verts[:, 2].max() < 0.6
    few = ball[:100]
    found = surface_of(OrientedPoints(few, few)).reference
    assert found.topology.characteristics == (2,)
    assert np.median(np.linalg.norm(found.verts, axis=1)) == pytest.approx(1, abs=0.2)


def test_noise_is_refused_before_anything_costly_is_made_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for mesh, known in ((icosphere(0), 1), (torus(n=6, m=4), 3), (grid(2), 1), (join(torus(), torus()), 6)):
        verts, faces = arrays(mesh)
        assert topology(faces, glue(verts, faces)).fewest_faces == known
    values = np.random.default_rng(0).normal(size=(20, 20, 20))
    values[[0, -1]] = values[:, [0, -1]] = values[:, :, [0, -1]] = 1
    noise = DistanceGrid(values, np.zeros(3), np.ones(3))
    rough = surface_of(noise).reference
    assert rough.topology.fewest_faces > 800
    with monkeypatch.context() as patched:
        patched.setattr("meshdeform.kinds.surface_fit.collapse.collapsed", None)
        wanted = f"{rough.topology.genus} handles .* need a base of {rough.topology.fewest_faces} faces or more"
        with pytest.raises(AssetError, match=wanted) as caught:
            base_of(rough, 200)
    assert "noise" in caught.value.advice_text
    with monkeypatch.context() as patched:
        patched.setattr("meshdeform.kinds.surface_fit.surface_sources.clean", None)
        with pytest.raises(AssetError, match=r"about \d{3} handles, which need a base of \d{3,4} faces"):
            surface_of(noise, 200)
    monkeypatch.setattr("meshdeform.geometry.isosurface._MOST_CUBES", 5000)
    with pytest.raises(AssetTooLargeError, match="cells of the grid; the limit is 5000"):
        surface_of(noise)


def test_an_error_of_nothing_is_none_and_a_coarse_input_is_not_held_against_a_field() -> None:
    verts, faces = arrays(icosphere(1))
    count = len(verts)

    def balls(number: int) -> CleanMesh:
        shift = 3.0 * np.repeat(np.arange(number), count)[:, None] * [1, 0, 0]
        return clean(np.tile(verts, (number, 1)) + shift, np.concatenate([faces + k * count for k in range(number)]))

    many = balls(EIGENVALUES)
    found = Reference(surface_of(many)).compare(delaunay(many.verts, many.faces), many.verts)
    assert found["eigenvalues"]["mean_relative_error"] is None
    assert found["geodesics"]["mean_relative_error"] < 0.05
    # From the first of two balls no distance leads to the other, where the nearest of the moved ones is.
    two = balls(2)
    moved = two.verts + [3.0, 0, 0]
    found = Reference(surface_of(two)).compare(delaunay(moved, two.faces), moved)
    assert 0 < found["geodesics"]["mean_relative_error"] < 0.5
    json.dumps(found, allow_nan=False)
    # Eigenvalues of a cube are far off on its twelve triangles; the same cube in 12,288 has none of that error.
    coarse = clean(*arrays(box(1)))
    verts, faces = divided(coarse.verts, coarse.faces, 12 * 4**5)
    assert len(faces) == 12 * 4**5
    assert volume(verts, faces) == pytest.approx(volume(coarse.verts, coarse.faces))
    found = Reference(surface_of(coarse)).compare(delaunay(verts, faces), verts)
    assert len(found["eigenvalues"]["input"]) == EIGENVALUES
    assert found["eigenvalues"]["mean_relative_error"] < 1e-3
    assert found["geodesics"]["mean_relative_error"] < 0.01


# Distances that are stored in a band around a surface, and a constant beyond it.


CENTRE = [1.83, 1.7, 2.0]


def test_distances_in_a_band_become_their_ball_beyond_it_too() -> None:
    spacing = np.full(3, 0.25)
    cells = np.moveaxis(np.indices((18, 18, 18)), 0, -1) * spacing
    distances = np.linalg.norm(cells - CENTRE, axis=-1) - 1
    surface = surface_of(DistanceGrid(np.clip(distances, -0.75, 0.75), np.zeros(3), spacing))
    assert surface.reference.topology.characteristics == (2,)
    directions = np.concatenate([np.eye(3), -np.eye(3), np.full((1, 3), 3**-0.5)])
    for radius in (0.15, 0.6, 1.0, 1.45):  # 0.15 and 1.45 at the corner are beyond the band
        place, normal = surface.project(CENTRE + radius * directions, np.zeros_like(directions))
        assert np.linalg.norm(place - CENTRE, axis=1) == pytest.approx(1, abs=0.02)
        assert np.linalg.norm(place - CENTRE - directions, axis=1).max() < 0.1
        assert (normal * directions).sum(1).min() > 0.99


# Flips, spectra and geodesics, with a plane and spheres as known answers.


def test_flips_in_a_plane_give_the_delaunay_triangulation() -> None:
    random = np.random.default_rng(3)
    mesh = grid(12)
    verts, faces = mesh.verts.copy(), mesh.faces
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


def test_the_spectrum_of_a_sphere_is_known_and_geodesics_on_it_are_angles() -> None:
    mesh = icosphere(4)
    found = delaunay(mesh.verts, mesh.faces)
    values, functions = spectrum(found, 16)
    known = [0.0] + [2.0] * 3 + [6.0] * 5 + [12.0] * 7  # l (l + 1)
    assert values == pytest.approx(known, rel=0.005, abs=1e-6)
    gram = functions.T @ (mass(found)[:, None] * functions)
    assert np.abs(gram - np.eye(16)).max() < 1e-6
    both = join(mesh, icosphere(0))
    apart = HeatGeodesics(delaunay(both.verts, both.faces)).distances([0])
    angles = np.arccos(np.clip(mesh.verts @ mesh.verts[0], -1, 1))
    assert np.abs(apart[: len(angles)] - angles).max() < 0.05
    assert np.isinf(apart[len(angles) :]).all(), "other parts are infinitely far"


def test_geodesics_of_parts_beside_one_of_which_they_are_nothing() -> None:
    """A shift of the whole by its area is below what floats hold beside a small part, whose last pivot may be zero."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    squares = [corners * 1e-6 + [3.0 * k, 0, 0] for k in range(9)]
    faces = [np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(10)]
    mesh = delaunay(np.concatenate([corners * 1e6, *squares]), np.concatenate(faces))
    assert np.isfinite(spectrum(mesh, 8)[0]).all()
    found = HeatGeodesics(mesh).distances([4])
    assert found[[4, 5, 7]] == pytest.approx([0.0, 1e-6, 1e-6], rel=0.2, abs=1e-9)
    assert np.isinf(found[8:]).all()


def uneven_sphere() -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere with most of its vertices in a small cap, as a base has them where a surface bends."""
    random = np.random.default_rng(0)
    around, height = random.uniform(0, 2 * np.pi, 4000), random.uniform(0.98, 1.0, 4000)
    cap = np.stack([np.cos(around), np.sin(around), height], 1)
    cap[:, :2] *= np.sqrt(1 - height**2)[:, None]
    verts = np.concatenate([icosphere(3).verts, cap])
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
