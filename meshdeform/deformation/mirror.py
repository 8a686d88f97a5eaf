"""Keep a symmetric mesh symmetric: average every displacement with that of the mirrored place.

With P the matrix that takes the value at the mirror image of each vertex, and R the reflection::

    d <- (d + R P d) / 2

On pairs of vertices this is exact: partners move by mirrored amounts, and a vertex on the plane stays on it. The mesh
is as symmetric afterwards as at rest, to the last bit of the displacements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.deformation.binding import corner_normals
from meshdeform.geometry.mesh import RestMesh, sparse_product
from meshdeform.geometry.places import NearestPlaces

TOLERANCE = 1e-4
"""Distance, as a share of the diagonal, up to which a vertex counts as the mirror image of another."""

_Index = NDArray[np.int64]


@dataclass(frozen=True)
class Partners:
    """The mirrored partner of each vertex."""

    axis: int  # the axis to which the plane is perpendicular; it passes through the middle of the bounding box
    partner: _Index  # (V,) int64: the nearest vertex to each vertex's mirror image
    deviation: float  # greatest distance of a vertex's mirror image from its partner, as a share of the diagonal
    unmatched: int  # vertices without a partner of their own within `TOLERANCE`


def find_partners(mesh: RestMesh, axis: int) -> Partners:
    """Match every vertex with its mirror image across the plane through the middle of the bounding box."""
    points = mesh.verts.numpy()
    low, high = points.min(0), points.max(0)
    mirrored = points.copy()
    mirrored[:, axis] = low[axis] + high[axis] - points[:, axis]
    distance, partner = cKDTree(points).query(mirrored)
    diagonal = float(np.linalg.norm(high - low))
    own = partner[partner] == np.arange(len(points))
    unmatched = int((~own | (distance > TOLERANCE * diagonal)).sum())
    return Partners(axis, partner.astype(np.int64), float(distance.max()) / diagonal, unmatched)


@dataclass(frozen=True)
class Mirror:
    """A mirror plane of one mesh."""

    axis: int  # the axis to which it is perpendicular
    across: sparse.csr_matrix  # sparse (V, V): takes values of the vertices to their mirror images

    @classmethod
    def of_partners(cls, found: Partners) -> Mirror:
        """Return the mirror of a mesh whose vertices all have a partner."""
        count = len(found.partner)
        rows = np.arange(count + 1)
        return cls(found.axis, sparse.csr_matrix((np.ones(count), found.partner, rows), shape=(count, count)))

    @classmethod
    def of_surface(cls, mesh: RestMesh, axis: int, plane: float) -> Mirror:
        """Return the mirror of a mesh whose surface alone is symmetric, at `plane` along the axis."""
        points, normals = mesh.verts.numpy().copy(), corner_normals(mesh)
        points[:, axis] = 2 * plane - points[:, axis]
        normals[:, axis] *= -1
        places = NearestPlaces(mesh, points, normals)
        count = len(points)
        rows = 3 * np.arange(count + 1)
        values, columns = places.weights.ravel(), places.corners.ravel()
        return cls(axis, sparse.csr_matrix((values, columns, rows), shape=(count, count)))

    def average(self, moved: Tensor) -> Tensor:
        """Return displacements (V, 3) averaged with those of the mirror images."""
        signs = torch.ones(3, dtype=torch.float64)
        signs[self.axis] = -1.0
        return 0.5 * (moved + signs * sparse_product(self.across, moved))

    def matrix(self, axis: int) -> sparse.csr_matrix:
        """Return the matrix (V, V) with which `average` acts on one coordinate."""
        sign = -1.0 if axis == self.axis else 1.0
        return (0.5 * (sparse.identity(self.across.shape[0]) + sign * self.across)).tocsr()
