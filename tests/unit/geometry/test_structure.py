"""What a deformation did to the structure of an asset, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets.notices import looks_z_up
from meshdeform.geometry.congruence import closest_motion, components_of, congruent_groups, is_of_revolution
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.structure_changes import measure_structure
from tests.cases import each_case
from training.evaluation.sources import SOURCES, source_mesh
from training.shapes import box, lathe, torus

Floats = NDArray[np.float64]


def moved(mesh: TriangleMesh, verts: Floats | NDArray[np.float64]) -> TriangleMesh:
    return TriangleMesh(verts, mesh.faces)


def placed(mesh: TriangleMesh, size: tuple[float, float, float], at: tuple[float, float, float]) -> TriangleMesh:
    return moved(mesh, mesh.verts * np.array(size, np.float64) + np.array(at, np.float64))


def sled() -> TriangleMesh:
    """Two blocks, one standing on the front of the other: a mirror image of itself across x = 0 only."""
    low, high = placed(box(6), (1, 0.5, 2), (0, 0, 0)), placed(box(6), (0.5, 0.5, 0.5), (0, 0.5, 0.7))
    return join(low, high)


@each_case("factors", [(3.0, 3.0, 3.0), (1.0, 2.0, 0.5)])
def test_scaling_along_the_axes_keeps_symmetry_and_flatness(factors: tuple[float, float, float]) -> None:
    kept = measure_structure(sled(), placed(sled(), factors, (5.0, -2.0, 1.0)))
    assert kept.asymmetry == pytest.approx(0, abs=1e-9)
    assert kept.flatness == pytest.approx(0, abs=1e-9)
    kept = measure_structure(sled(), sled())
    assert (kept.asymmetry, kept.flatness, kept.contacts, kept.components) == (0.0, 0.0, 0.0, 2)


def test_a_shear_across_the_mirror_plane_is_measured() -> None:
    source = sled()
    verts = source.verts.copy()
    verts[:, 0] += 0.4 * verts[:, 1]
    kept = measure_structure(source, moved(source, verts))
    # Mirror images at height y end up 2 |0.4 y - c| apart, with c the median of 0.4 y.
    rng = np.random.default_rng(1)
    a, b, c = source.verts[source.faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(areas), 100_000, p=areas / areas.sum())
    root, second = np.sqrt(rng.random(100_000))[:, None], rng.random(100_000)[:, None]
    heights = ((1 - root) * a[face] + root * (1 - second) * b[face] + root * second * c[face])[:, 1]
    expected = 2 * 0.4 * np.abs(heights - np.median(heights)).mean() / np.linalg.norm(np.ptp(verts, axis=0))
    assert kept.asymmetry == pytest.approx(expected, rel=0.03)
    assert kept.flatness == pytest.approx(0, abs=1e-9)


def test_a_bent_plate_has_lost_its_flatness() -> None:
    plate = placed(box(12), (2, 0.01, 2), (0, 0, 0))
    verts = plate.verts.copy()
    verts[:, 1] += 0.1 * verts[:, 0] ** 2
    kept = measure_structure(plate, moved(plate, verts))
    heights = plate.verts[:, 1]
    top = np.flatnonzero(heights == heights.max())
    rms = verts[top, 1].std()
    expected = rms / np.linalg.norm(np.ptp(verts[top], axis=0))
    assert kept.flatness == pytest.approx(expected, rel=0.05)


def test_parts_that_come_apart_leave_a_gap() -> None:
    source = join(placed(box(10), (1, 1, 1), (0, 0, 0)), placed(box(10), (1, 1, 1), (0, 1, 0)))
    verts = source.verts.copy()
    verts[verts.shape[0] // 2 :, 1] += 0.5
    kept = measure_structure(source, moved(source, verts))
    # Places that touched were up to a hundredth of the diagonal apart.
    assert kept.contacts == pytest.approx(0.5 / np.linalg.norm(np.ptp(verts, axis=0)), rel=0.05)


def test_what_a_source_does_not_have_is_not_measured() -> None:
    blob = icosphere(4)
    rng = np.random.default_rng(0)
    lumpy = moved(blob, blob.verts * (1 + 0.3 * np.sin(blob.verts @ rng.normal(size=(3, 1)) * 2)))
    kept = measure_structure(lumpy, lumpy)
    assert (kept.asymmetry, kept.flatness, kept.contacts, kept.components) == (None, None, None, 1)


# A mesh that plainly stands on its lowest Z is noticed; everything else is not.


def answer(mesh: TriangleMesh) -> bool:
    return looks_z_up(mesh.verts, mesh.faces)


def with_z_up(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh as a program with Z up exports it: X, -Z, Y."""
    return TriangleMesh(mesh.verts[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0], np.float64), mesh.faces)


STATUE = lathe([(0.0, 0.0), (0.5, 0.0), (0.4, 0.3), (0.1, 0.6), (0.3, 1.2), (0.0, 1.6)])


def test_only_what_stands_on_its_lowest_z_is_noticed() -> None:
    assert answer(with_z_up(STATUE))
    for mesh in (STATUE, box(2, (1.0, 1.0, 0.05)), *map(source_mesh, SOURCES)):
        assert not answer(mesh)
    for faces in (np.zeros((0, 3), np.int64), np.array([[0, 1, 2]])):
        assert not looks_z_up(np.zeros((3, 3)), faces)


# Congruent components and components of revolution, against shapes of which both are known.


RANDOM = np.random.default_rng(5)
TURN = np.linalg.qr(RANDOM.normal(size=(3, 3)))[0]


def changed(mesh: TriangleMesh, linear: np.ndarray, *, shuffled: bool = False, at: float = 0.0) -> TriangleMesh:
    """Map the vertices, and renumber them if asked."""
    order = RANDOM.permutation(len(mesh.verts)) if shuffled else np.arange(len(mesh.verts))
    verts = (mesh.verts @ linear.T + at)[order]
    faces = np.argsort(order)[mesh.faces]
    return TriangleMesh(verts, faces)


def prism(sides: int, height: float) -> TriangleMesh:
    """A regular prism about Z."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], 1)
    verts = np.concatenate([ring, ring + [0, 0, height], [[0, 0, 0], [0, 0, height]]])
    first, second = np.arange(sides), (np.arange(sides) + 1) % sides
    low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    corners = [(first, second, second + sides), (first, second + sides, first + sides)]
    corners += [(second, first, low), (first + sides, second + sides, high)]
    faces = np.concatenate([np.stack(corner, 1) for corner in corners])
    return TriangleMesh(verts, faces)


def test_congruent_components_are_found_in_any_pose_order_and_mirrored() -> None:
    brick = changed(box(2), np.diag([1.0, 2.0, 3.0]))
    dented = TriangleMesh(brick.verts.copy(), brick.faces)
    dented.verts[0] *= 0.98
    mesh = RestMesh.of(
        join(
            brick,
            changed(torus(n=9, m=6), np.eye(3), at=10.0),
            changed(brick, TURN, at=20.0),
            changed(brick, TURN @ np.diag([-1.0, 1, 1]), shuffled=True, at=30.0),
            changed(torus(n=9, m=6), TURN, at=40.0),
            changed(brick, 1.01 * np.eye(3), at=50.0),
            changed(dented, np.eye(3), at=60.0),
        )
    )
    components = components_of(mesh)
    assert [component.number for component in components] == list(range(7))
    assert congruent_groups(components) == [[0, 2, 3], [1, 4]]


@each_case(
    "mesh,expected",
    [
        (torus(n=16, m=8), True),
        (icosphere(2), True),
        (prism(24, 0.3), True),
        (prism(24, 5.0), True),
        (prism(6, 0.5), False),
        (prism(4, 1.0), False),
        (box(3), False),
        (changed(icosphere(2), np.diag([1.0, 1.4, 0.7])), False),
        (changed(torus(n=16, m=8), np.diag([1.2, 1.0, 1.0])), False),
    ],
    ids=["torus", "ball", "disc", "rod", "hexagon", "bar", "cube", "egg of three axes", "oval ring"],
)
@each_case("pose", [np.eye(3), 1e-3 * TURN], ids=["upright", "turned and small"])
def test_shapes_of_revolution(mesh: TriangleMesh, expected: bool, pose: np.ndarray) -> None:
    (component,) = components_of(RestMesh.of(changed(mesh, pose, at=0.3)))
    assert is_of_revolution(component) is expected


def test_the_closest_motion_is_the_one_that_was_made() -> None:
    points = RANDOM.normal(size=(20, 3))
    turn = TURN * np.sign(np.linalg.det(TURN))
    goal = 1.7 * points @ turn.T + [1, 2, 3]
    found = closest_motion(points, goal, scaled=True)
    np.testing.assert_allclose(found.rotation, turn, atol=1e-12)
    assert (found.scale, found.max_distance) == (pytest.approx(1.7), pytest.approx(0, abs=1e-12))
    np.testing.assert_allclose(found.shift, [1, 2, 3], atol=1e-12)
    assert closest_motion(points, goal).max_distance > 0.1
    mirror = points * [-1, 1, 1]
    assert closest_motion(points, mirror).max_distance > 0.1
    assert closest_motion(points, mirror, mirrored=True).max_distance < 1e-12
    assert np.linalg.det(closest_motion(points, mirror).rotation) == pytest.approx(1)
