"""Manufactured meshes: closed ones are outward oriented and free of duplicate vertices; for tests and examples.

All are +Y up, centred at the origin unless said otherwise, in object units, and deterministic.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.errors import ShapeError
from meshdeform.mesh import TriangleMesh

__all__ = ["box", "cylinder", "grid", "icosphere", "join", "lathe", "torus", "uv_sphere"]

_Array = NDArray[np.float64]
_Index = NDArray[np.int64]


def _mesh(verts: _Array, faces: _Index) -> TriangleMesh:
    return TriangleMesh(
        torch.from_numpy(np.ascontiguousarray(verts, np.float64)),
        torch.from_numpy(np.ascontiguousarray(faces, np.int64)),
    )


def _quads_to_faces(a: _Index, b: _Index, c: _Index, d: _Index) -> _Index:
    """Split quads a b c d (counter-clockwise) along the diagonal a c."""
    split = np.stack([a, b, c, a, c, d], -1)
    return split.reshape(-1, 3)


def icosphere(subdivisions: int = 3, radius: float = 1.0) -> TriangleMesh:
    """Sphere from a subdivided icosahedron: 20 * 4^n faces, 10 * 4^n + 2 vertices (n = 4: 5,120 and 2,562).

    Parameters
    ----------
    subdivisions : int
        n >= 0; each splits every face in four.
    radius : float
        Object units.
    """
    if subdivisions < 0:
        raise ShapeError(f"subdivisions must be 0 or more, got {subdivisions}")
    t = (1.0 + math.sqrt(5.0)) / 2.0
    verts = np.array(
        [
            [-1, t, 0], [1, t, 0], [-1, -t, 0], [1, -t, 0], [0, -1, t], [0, 1, t],
            [0, -1, -t], [0, 1, -t], [t, 0, -1], [t, 0, 1], [-t, 0, -1], [-t, 0, 1],
        ]
    )  # fmt: skip
    faces = np.array(
        [
            [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2],
            [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5],
            [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
        ]
    )  # fmt: skip
    verts /= np.linalg.norm(verts, axis=1, keepdims=True)
    for _ in range(subdivisions):
        sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        edges, middle = np.unique(sides, axis=0, return_inverse=True)
        ab, bc, ca = (middle.reshape(3, -1) + len(verts)).astype(np.int64)
        a, b, c = faces.T
        faces = np.concatenate([np.stack(f, 1) for f in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        points = verts[edges].sum(1)
        verts = np.concatenate([verts, points / np.linalg.norm(points, axis=1, keepdims=True)])
    return _mesh(verts * radius, faces)


def lathe(profile: Sequence[tuple[float, float]], segments: int = 32) -> TriangleMesh:
    """Surface of revolution about +Y.

    Parameters
    ----------
    profile : sequence of (radius, height)
        From the bottom to the top, at least two points, radii >= 0; radius 0 is allowed only at the ends, where it
        makes one pole vertex. An end off the axis stays an open border.
    segments : int
        Corners of a full turn, at least 3.
    """
    points = np.asarray(profile, np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or segments < 3:
        raise ShapeError("a lathe needs two or more (radius, height) points and three or more segments")
    if (points[:, 0] < 0).any() or (points[1:-1, 0] == 0).any():
        raise ShapeError("radii must be positive; only the first and the last may be 0")
    angle = np.arange(segments) * (2 * math.pi / segments)
    verts: list[_Array] = []
    rings: list[_Index] = []
    count = 0
    for radius, height in points:
        on_axis = radius == 0
        around = angle[:1] if on_axis else angle
        ring = np.stack([radius * np.sin(around), np.full_like(around, height), radius * np.cos(around)], 1)
        # A pole is one vertex that stands for the whole ring.
        rings.append(np.full(segments, count) if on_axis else count + np.arange(segments))
        verts.append(ring)
        count += len(ring)
    faces = []
    for low, high in itertools.pairwise(rings):
        after = np.roll(low, -1), np.roll(high, -1)
        faces.append(_quads_to_faces(low, after[0], after[1], high))
    joined = np.concatenate(faces)
    distinct = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    return _mesh(np.concatenate(verts), joined[distinct])


def uv_sphere(rings: int = 16, segments: int = 32, radius: float = 1.0) -> TriangleMesh:
    """Sphere of latitude rings (at least 2) and longitude segments, with one vertex at each pole."""
    if rings < 2:
        raise ShapeError(f"rings must be 2 or more, got {rings}")
    polar = np.linspace(0.0, math.pi, rings + 1)
    profile = [(0.0, -radius)]
    profile += [(radius * math.sin(p), -radius * math.cos(p)) for p in polar[1:-1]]
    return lathe([*profile, (0.0, radius)], segments)


def cylinder(
    radius: float = 0.5, height: float = 1.0, segments: int = 32, rings: int = 8, *, capped: bool = True
) -> TriangleMesh:
    """Cylinder about +Y of `rings` bands; without caps it is an open tube with two borders."""
    wall = [(radius, -height / 2 + height * i / rings) for i in range(rings + 1)]
    if capped:
        wall = [(0.0, -height / 2), *wall, (0.0, height / 2)]
    return lathe(wall, segments)


def torus(radius: float = 1.0, tube: float = 0.35, segments: int = 48, sides: int = 24) -> TriangleMesh:
    """Torus about +Y: `radius` of the ring's centre line, `tube` of its section."""
    u = np.arange(segments)[:, None] * (2 * math.pi / segments)
    v = np.arange(sides)[None, :] * (2 * math.pi / sides)
    reach = radius + tube * np.cos(v)
    verts = np.stack([reach * np.sin(u), tube * np.sin(v) + 0 * u, reach * np.cos(u)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(segments), np.arange(sides), indexing="ij")
    i2, j2 = (i + 1) % segments, (j + 1) % sides
    corner = [(p * sides + q).reshape(-1) for p, q in ((i, j), (i2, j), (i2, j2), (i, j2))]
    return _mesh(verts, _quads_to_faces(*corner))


def grid(columns: int = 8, rows: int = 8, width: float = 1.0, height: float = 1.0) -> TriangleMesh:
    """Flat open rectangle in the plane z = 0 that faces +Z."""
    x = np.linspace(-width / 2, width / 2, columns + 1)
    y = np.linspace(-height / 2, height / 2, rows + 1)
    xx, yy = np.meshgrid(x, y, indexing="ij")
    verts = np.stack([xx, yy, np.zeros_like(xx)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    corner = [(p * (rows + 1) + q).reshape(-1) for p, q in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))]
    return _mesh(verts, _quads_to_faces(*corner))


def box(size: Sequence[float] = (1.0, 1.0, 1.0), subdivisions: int = 1) -> TriangleMesh:
    """Axis-aligned closed box; each side is split in `subdivisions` x `subdivisions` quads, shared at the edges."""
    if subdivisions < 1:
        raise ShapeError(f"subdivisions must be 1 or more, got {subdivisions}")
    n = subdivisions
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    quads = []
    for axis in range(3):
        for side in (0, n):
            lattice = np.empty((n, n, 4, 3), np.int64)
            # (u, v, axis) is right-handed, so u then v runs counter-clockwise seen from +axis.
            u, v = (axis + 1) % 3, (axis + 2) % 3
            for corner, (di, dj) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                lattice[:, :, corner, axis] = side
                lattice[:, :, corner, u] = i + di
                lattice[:, :, corner, v] = j + dj
            quads.append(lattice.reshape(-1, 4, 3)[:, :: 1 if side else -1])
    lattice_points, index = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    verts = (lattice_points / n - 0.5) * np.asarray(size, np.float64)
    return _mesh(verts, _quads_to_faces(*index.reshape(-1, 4).T.astype(np.int64)))


def join(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Put meshes side by side in one mesh; they stay separate components."""
    starts = np.cumsum([0, *(mesh.n_verts for mesh in meshes)])
    return TriangleMesh(
        torch.cat([mesh.verts for mesh in meshes]),
        torch.cat([mesh.faces + int(start) for mesh, start in zip(meshes, starts[:-1], strict=True)]),
    )
