"""Searches that numpy does give what numba's give, and numba is imported once it is worth that."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.geometry import nearest_points
from meshdeform.geometry.kernels import Worth
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import NearestPoints
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from training.shapes import box, torus, uv_sphere

SOUP = TriangleMesh(np.random.default_rng(1).normal(size=(60, 3)), np.random.default_rng(2).integers(0, 60, (90, 3)))


@each_case("mesh", [icosphere(3), torus(), uv_sphere(8, 40), join(box(1), icosphere(2)), SOUP])
def test_numpy_walks_to_the_same_places(mesh: TriangleMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    rest, random = RestMesh.of(mesh), np.random.default_rng(0)
    points = np.concatenate([mesh.verts, random.normal(size=(400, 3)), mesh.verts[:9] * 1e-3])
    found: list[tuple[NDArray[np.int64], NDArray[np.float64]]] = []
    for compiled in (True, False):
        monkeypatch.setattr(nearest_points, "_compiles", lambda _count, chosen=compiled: chosen)
        nearest = NearestPoints(rest, points, np.zeros_like(points))
        found.append((nearest.faces, nearest.weights))
    assert np.array_equal(found[0][0], found[1][0])
    np.testing.assert_array_equal(found[0][1], found[1][1])
    # No other place on the face, and no face around it, is nearer.
    assert found[0][1].min() >= -1e-12


def test_numba_is_worth_its_import_from_so_much_work_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    worth = Worth(10)
    assert [worth(4), worth(6), worth(1), worth(0)] == [False, False, True, True]
    monkeypatch.setitem(sys.modules, "numba", None)
    assert Worth(10)(1)
