"""Bind landmarks to a surface, and measure how far they are from their goals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import SurfaceTree, blend_matrix

_Floats = NDArray[np.float64]

LIMITS = (0.10, 0.02)
"""Greatest distance of a pair of points at the first and at the last step, as a share of the diagonal."""


@dataclass(frozen=True)
class Landmark:
    """A point (3,) float64 of the mesh at rest, and the point (3,) float64 to which it goes."""

    source: _Floats
    target: _Floats


def bound(landmarks: Sequence[Landmark], mesh: TriangleMesh) -> sparse.csr_matrix:
    """Return the matrix (L, V) that takes the landmarks from the vertices: the nearest points on the mesh at rest."""
    rest = RestMesh.of(mesh)
    verts, faces = rest.verts, rest.faces
    spacing = 0.02 * float(np.linalg.norm(np.ptp(verts, axis=0)))
    tree = SurfaceTree(verts, faces, rest.normals, spacing=spacing, opposite=0.0)
    sources = np.array([each.source for each in landmarks])
    face, weights = tree.find(sources, np.zeros_like(sources))
    return blend_matrix(faces[face], weights, len(verts))


def landmark_distances(landmarks: Sequence[Landmark], mesh: TriangleMesh, verts: _Floats) -> _Floats:
    """Return the distance (L,) of each landmark from its goal in a shape (V, 3) of the mesh."""
    goals = np.array([each.target for each in landmarks])
    return np.asarray(np.linalg.norm(bound(landmarks, mesh) @ verts - goals, axis=1))


def diagonal_of(mesh: TriangleMesh) -> float:
    """Return the diagonal of the bounding box of the vertices that faces use."""
    used = mesh.verts[np.unique(mesh.faces)]
    return float(np.linalg.norm(np.ptp(used, axis=0)))
