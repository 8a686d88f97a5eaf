"""Generate simple meshes.

Simplify a mesh by quadric edge collapses.

fast-simplification (MIT) does the work. pyfqmr wraps the same algorithm and gives the same mesh; it took 1.7 times as
long for a million faces, and 1.6 times the memory.

Source: Garland and Heckbert 1997, Surface Simplification Using Quadric Error Metrics.
"""

from __future__ import annotations

import math

import fast_simplification
import numpy as np
import torch
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh


def icosphere(subdivisions: int = 3, radius: float = 1.0) -> TriangleMesh:
    """Return a sphere of 20 * 4^subdivisions nearly equal triangles around the origin."""
    g = (1 + math.sqrt(5)) / 2
    verts = torch.tensor(
        [
            *[(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)],
            *[(0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g)],
            *[(g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)],
        ],
        dtype=torch.float64,
    )
    faces = torch.tensor(
        [
            *[(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11)],
            *[(1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8)],
            *[(3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9)],
            *[(4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)],
        ]
    )
    verts = torch.nn.functional.normalize(verts, dim=1)
    for _ in range(subdivisions):
        verts, faces = _split(verts, faces)
        verts = torch.nn.functional.normalize(verts, dim=1)
    return TriangleMesh(verts * radius, faces)


def _split(verts: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Split every triangle into four, with shared midpoints."""
    pairs = torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).sort(1).values
    unique, inverse = torch.unique(pairs, dim=0, return_inverse=True)
    middle = verts[unique].mean(1)
    ab, bc, ca = (inverse + verts.shape[0]).view(3, -1)
    a, b, c = faces.unbind(1)
    parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return torch.cat([verts, middle]), torch.stack([torch.stack(p, 1) for p in parts], 1).reshape(-1, 3)


def join(*meshes: TriangleMesh) -> TriangleMesh:
    """Join several meshes into one with several components."""
    offsets = [0]
    for mesh in meshes:
        offsets.append(offsets[-1] + mesh.verts.shape[0])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
    return TriangleMesh(torch.cat([mesh.verts for mesh in meshes]), torch.cat(faces))


_MOST_AROUND = 200
"""Faces around the corners of a face, in the mean, up to which a mesh is simplified: each edge that is tried takes time
for every one. A smooth surface has 18."""


def simplified(mesh: TriangleMesh, count: int) -> TriangleMesh:
    """Return a mesh of about `count` faces with the shape of a larger one, and without unused vertices.

    It has more faces where they cannot be collapsed, and none if all were. Borders may move. Where very many faces meet
    at one vertex, as where copies lie in one place, the mesh is returned as it is.
    """
    around = np.bincount(mesh.faces.numpy().ravel())
    if float((around.astype(np.float64) ** 2).sum()) > _MOST_AROUND * len(mesh.faces):
        return mesh
    verts, faces = fast_simplification.simplify(
        mesh.verts.numpy(), mesh.faces.numpy().astype(np.int32), target_count=count
    )
    used, corners = np.unique(faces, return_inverse=True)
    return TriangleMesh(
        torch.from_numpy(np.asarray(verts, np.float64)[used]), torch.from_numpy(corners.reshape(-1, 3).astype(np.int64))
    )
