"""Generate simple meshes, and simplify others."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.collapsing import collapsed
from meshdeform.geometry.edge_splits import unique_edges
from meshdeform.geometry.mesh import TriangleMesh, safe_normalize

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


def icosphere(subdivisions: int = 3, radius: float = 1.0) -> TriangleMesh:
    """Return a sphere of 20 * 4^subdivisions nearly equal triangles around the origin."""
    g = (1 + math.sqrt(5)) / 2
    verts = np.array(
        [
            *[(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)],
            *[(0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g)],
            *[(g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)],
        ],
        dtype=np.float64,
    )
    faces = np.array(
        [
            *[(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11)],
            *[(1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8)],
            *[(3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9)],
            *[(4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)],
        ],
        dtype=np.int64,
    )
    verts = safe_normalize(verts)
    for _ in range(subdivisions):
        verts, faces = _split(verts, faces)
        verts = safe_normalize(verts)
    return TriangleMesh(verts * radius, faces)


def _split(verts: _Floats, faces: _Index) -> tuple[_Floats, _Index]:
    """Split every triangle into four, with shared midpoints."""
    edges, sides = unique_edges(faces)
    middle = (verts[edges[:, 0]] + verts[edges[:, 1]]) / 2
    (a, b, c), (ab, bc, ca) = faces.T, sides.T + len(verts)
    quarters = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return np.concatenate([verts, middle]), np.stack([np.stack(p, 1) for p in quarters], 1).reshape(-1, 3)


def join(*meshes: TriangleMesh) -> TriangleMesh:
    """Join several meshes into one with several components."""
    offsets = [0]
    for mesh in meshes:
        offsets.append(offsets[-1] + mesh.verts.shape[0])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
    return TriangleMesh(np.concatenate([mesh.verts for mesh in meshes]), np.concatenate(faces))


def simplified(mesh: TriangleMesh, count: int) -> TriangleMesh:
    """Return a mesh of about `count` faces with the shape of a larger one, and without unused vertices.

    As `collapsing.collapsed`, which may return the mesh itself.
    """
    verts, faces = collapsed(mesh.verts, mesh.faces, count)
    return mesh if faces is mesh.faces else TriangleMesh(verts, faces)
