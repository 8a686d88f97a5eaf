"""Generate simple meshes, and simplify others."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from meshdeform.geometry.collapsing import collapsed
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


def simplified(mesh: TriangleMesh, count: int) -> TriangleMesh:
    """Return a mesh of about `count` faces with the shape of a larger one, and without unused vertices.

    As `collapsing.collapsed`, which may return the mesh itself.
    """
    verts, faces = mesh.verts.numpy(), mesh.faces.numpy()
    fewer, corners = collapsed(verts, faces, count)
    return mesh if corners is faces else TriangleMesh(torch.from_numpy(fewer), torch.from_numpy(corners))
