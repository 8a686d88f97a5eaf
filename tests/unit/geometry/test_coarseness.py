"""Triangles too large to bend: which assets are warned about."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.assets.notices import coarse_share, coarseness_warnings
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import box, icosphere, join, torus
from tests.cases import each_case


def arrays(mesh: TriangleMesh, scale: float = 1.0):
    return mesh.verts.numpy() * scale, mesh.faces.numpy()


@each_case(
    "mesh,warned",
    [(box(1), True), (icosphere(0), True), (box(6), False), (icosphere(2), False), (torus(), False)],
    ids=["box", "icosahedron", "box 6", "sphere", "torus"],
)
@each_case("scale", [1e-3, 1e6])
def test_only_what_cannot_bend_is_warned_about(mesh, warned, scale) -> None:
    warnings = coarseness_warnings(*arrays(mesh, scale))
    assert bool(warnings) is warned
    if warned:
        assert "output.subdivide" in warnings[0]


def test_the_share_is_that_of_the_area() -> None:
    cube, rest = RestMesh.of(box(1)), RestMesh.of(torus())
    assert coarse_share(*arrays(join(cube, rest))) == pytest.approx(
        cube.areas.sum() / (cube.areas.sum() + rest.areas.sum())
    )
    assert coarse_share(np.zeros((3, 3)), np.array([[0, 1, 2]])) == 0.0
    assert coarseness_warnings(np.zeros((3, 3)), np.array([[0, 1, 2]])) == ()
