"""The manufactured meshes are what their names say: closed or open, outward, of the right volume."""

from __future__ import annotations

import math

import numpy as np
import pytest

from meshdeform.geometry.mesh import TriangleMesh, edges_of, face_areas
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from training.shapes import box, cylinder, lathe, torus, uv_sphere


def volume(mesh: TriangleMesh) -> float:
    a, b, c = mesh.verts[mesh.faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


@each_case(
    ("mesh", "expected"),
    [
        (icosphere(4), 4 / 3 * math.pi),
        (icosphere(4, 0.5), math.pi / 6),
        (uv_sphere(64, 128), 4 / 3 * math.pi),
        (torus(1.0, 0.25, 128, 64), 2 * math.pi**2 * 0.25**2),
        (cylinder(0.5, 3.0, 128), 0.75 * math.pi),
        (box(1), 1.0),
        (box(3, (1.0, 2.0, 0.5)), 1.0),
        (lathe([(0.0, 0.0), (1.0, 0.0), (0.0, 3.0)], 128), math.pi),
        (join(icosphere(4), icosphere(4)), 8 / 3 * math.pi),
    ],
)
def test_closed_shapes_enclose_their_volume_outward(mesh: TriangleMesh, expected: float) -> None:
    edges = edges_of(mesh.faces)
    assert bool((edges.counts == 2).all())
    assert bool(edges.consistent.all())
    assert float(face_areas(mesh.verts, mesh.faces).min()) > 0
    assert volume(mesh) == pytest.approx(expected, rel=5e-3)
