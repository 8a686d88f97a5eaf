"""Generate simple meshes for measurements, tests and benchmarks, beside those of `meshdeform.geometry.shapes`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import TriangleMesh


def _closed_grid(n: int, m: int, wrap_n: bool, wrap_m: bool) -> NDArray[np.int64]:
    """Return the triangles of an n x m grid of vertices, closed or open in each direction."""
    i, j = np.meshgrid(np.arange(n if wrap_n else n - 1), np.arange(m if wrap_m else m - 1), indexing="ij")
    k, q = (i + 1) % n, (j + 1) % m
    a, b, c, d = (i * m + j), (k * m + j), (k * m + q), (i * m + q)
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)


def grid(n: int = 10, size: float = 1.0) -> TriangleMesh:
    """Return an open square of 2 n^2 triangles in the plane z = 0, facing +Z."""
    x = np.linspace(-size / 2, size / 2, n + 1)
    u, v = np.meshgrid(x, x, indexing="ij")
    return TriangleMesh(np.stack([u, v, 0 * u], -1).reshape(-1, 3), _closed_grid(n + 1, n + 1, False, False))


def torus(major: float = 0.7, minor: float = 0.25, n: int = 48, m: int = 24) -> TriangleMesh:
    """Return a torus around the Y axis with 2 n m triangles."""
    u, v = (np.arange(count) / count * 2 * math.pi for count in (n, m))
    uu, vv = np.meshgrid(u, v, indexing="ij")
    ring = major + minor * np.cos(vv)
    verts = np.stack([ring * np.sin(uu), minor * np.sin(vv), ring * np.cos(uu)], -1).reshape(-1, 3)
    return TriangleMesh(verts, _closed_grid(n, m, True, True))


def lathe(profile: Sequence[tuple[float, float]], n: int = 32) -> TriangleMesh:
    """Return a surface of revolution around the Y axis, with `n` corners per turn.

    Parameters
    ----------
    profile : sequence of (radius, height)
        Two points or more, from bottom to top. A radius of 0 makes one pole vertex and is allowed only at the ends;
        an end off the axis is an open border.
    n : int
        At least 3.

    Raises
    ------
    ShapeError
        The profile or `n` is invalid.
    """
    if len(profile) < 2 or n < 3:
        raise ShapeError("a lathe needs two or more (radius, height) points and three or more corners per turn")
    if any(r < 0 for r, _ in profile) or any(r == 0 for r, _ in profile[1:-1]):
        raise ShapeError("radii must be positive; only the first and the last may be 0")
    turn = np.arange(n) / n * 2 * math.pi
    verts: list[NDArray[np.float64]] = []
    rings: list[NDArray[np.int64]] = []
    count = 0
    for radius, height in profile:
        around = turn if radius else turn[:1]
        verts.append(np.stack([radius * np.sin(around), np.full_like(around, height), radius * np.cos(around)], 1))
        # A pole is one vertex in place of a whole ring.
        rings.append(count + (np.arange(n) if radius else np.zeros(n, np.int64)))
        count += len(around)
    parts = []
    for low, high in itertools.pairwise(rings):
        low_next, high_next = np.roll(low, -1), np.roll(high, -1)
        parts.append(np.stack([low, low_next, high_next], 1))
        parts.append(np.stack([low, high_next, high], 1))
    a, b, c = (faces := np.concatenate(parts)).T
    return TriangleMesh(np.concatenate(verts), faces[(a != b) & (b != c) & (c != a)])


def uv_sphere(rings: int = 16, n: int = 32, radius: float = 1.0) -> TriangleMesh:
    """Return a sphere of `rings` bands of latitude and `n` of longitude, with needle-like triangles at its poles."""
    polar = [math.pi * i / rings for i in range(1, rings)]
    middle = [(radius * math.sin(p), -radius * math.cos(p)) for p in polar]
    return lathe([(0.0, -radius), *middle, (0.0, radius)], n)


def cylinder(
    radius: float = 0.5, height: float = 1.0, n: int = 32, rings: int = 8, *, capped: bool = True
) -> TriangleMesh:
    """Return a cylinder around the Y axis with `rings` bands; without caps, an open tube with two borders."""
    wall = [(radius, height * (i / rings - 0.5)) for i in range(rings + 1)]
    return lathe([(0.0, -height / 2), *wall, (0.0, height / 2)] if capped else wall, n)


def box(n: int = 1, size: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> TriangleMesh:
    """Return a closed box around the origin with n x n squares per side: 12 n^2 triangles."""
    side = grid(n)
    turns = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            basis = np.zeros((3, 3))
            basis[(axis + 1) % 3, 0], basis[(axis + 2) % 3, 1], basis[axis, 2] = sign, 1.0, sign
            turns.append(side.verts @ basis.T + 0.5 * basis[:, 2])
    points = np.concatenate(turns)
    faces = np.concatenate([side.faces + k * len(side.verts) for k in range(6)])
    _, inverse = np.unique(np.rint(points * 4 * n).astype(np.int64), axis=0, return_inverse=True)
    verts = np.empty((int(inverse.max()) + 1, 3))
    verts[inverse] = points
    return TriangleMesh(verts * size, inverse[faces])
