"""Congruent components and components of revolution, against shapes of which both are known."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from meshdeform.geometry.congruence import components_of, congruent_groups, is_of_revolution
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.procrustes import closest_motion
from meshdeform.geometry.shapes import box, icosphere, join, torus
from tests.cases import each_case

RANDOM = np.random.default_rng(5)
TURN = np.linalg.qr(RANDOM.normal(size=(3, 3)))[0]


def changed(mesh: TriangleMesh, linear: np.ndarray, *, shuffled: bool = False, at: float = 0.0) -> TriangleMesh:
    """Map the vertices, and renumber them if asked."""
    order = RANDOM.permutation(len(mesh.verts)) if shuffled else np.arange(len(mesh.verts))
    verts = (mesh.verts.numpy() @ linear.T + at)[order]
    faces = np.argsort(order)[mesh.faces.numpy()]
    return TriangleMesh(torch.from_numpy(verts), torch.from_numpy(faces))


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
    return TriangleMesh(torch.from_numpy(verts), torch.from_numpy(faces))


def test_congruent_components_are_found_in_any_pose_order_and_mirrored() -> None:
    brick = changed(box(2), np.diag([1.0, 2.0, 3.0]))
    dented = TriangleMesh(brick.verts.clone(), brick.faces)
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
