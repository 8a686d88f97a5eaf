"""Constrain where vertices may go: what is kept, and what is mirrored.

The vertices p that the variables give are placed in this order, with d = p - rest::

    d <- s d                  s = 0 where the surface is kept, rising with f = (distance from there) / fall-off as
                              f^2 (3 - 2 f) to 1: displacement and its derivative are continuous
    d <- (d + R P d) / 2      with a mirror (`mirror.py`)
    v  = rest + d

All of it is differentiable, and exact: a kept vertex has the bits of the rest shape.

Keep a symmetric mesh symmetric: average every displacement with that of the mirrored place.

With P the matrix that takes the value at the mirror image of each vertex, and R the reflection::

    d <- (d + R P d) / 2

On pairs of vertices this is exact: partners move by mirrored amounts, and a vertex on the plane stays on it. The mesh
is as symmetric afterwards as at rest, to the last bit of the displacements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.deformation.binding import corner_normals
from meshdeform.geometry.geodesic import surface_distances
from meshdeform.geometry.mesh import RestMesh, sparse_product
from meshdeform.geometry.places import NearestPlaces

_JOIN_EDGES = 2.0
"""Edges of a stand-in over which the whole mesh joins what is kept exactly: the stand-in has joined it already."""

_Floats = NDArray[np.float64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Handle:
    """A point of the surface that goes to a place."""

    corners: tuple[int, ...]  # vertices around the point
    shares: tuple[float, ...]  # their barycentric coordinates
    goal: _Floats  # (3,) float64
    weight: float = 1.0  # 1: it is exactly there; less: it goes this share of the way from where it would be otherwise


@dataclass(frozen=True)
class Constraints:
    """Constraints on the vertices of one mesh."""

    freedom: _Floats | None = None
    """(V,) float64: distance along the surface from what is kept, in fall-offs: 0 on kept vertices, 1 at the end of the
    fall-off and beyond. None if nothing is kept."""
    falloff: float = 0.0  # length of the fall-off in object units
    mirror: Mirror | None = None
    handles: Sequence[Handle] = ()

    @property
    def kept(self) -> _Flags | None:
        """Flags (V,) of the vertices that do not move; None if all may."""
        return None if self.freedom is None else self.freedom == 0

    @property
    def changes_start(self) -> bool:
        """Whether the shape at the start may differ from the rest shape."""
        return bool(self.handles)

    def placement(self, mesh: RestMesh) -> Placement | None:
        """Return the placement of the mesh's vertices; None if only handles constrain them."""
        if self.freedom is None and self.mirror is None:
            return None
        return Placement(mesh, self)

    def of_stand_in(self, simple: RestMesh, whole: RestMesh) -> Self:
        """Return the constraints of a simplified mesh; handles need the whole mesh."""
        freedom, mirror = self.freedom, self.mirror
        if freedom is not None:
            places = NearestPlaces(whole, simple.verts.numpy(), corner_normals(simple))
            freedom = places.blend(freedom[:, None])[:, 0]
        if mirror is not None:
            along = whole.verts[:, mirror.axis]
            mirror = Mirror.of_surface(simple, mirror.axis, float(along.min() + along.max()) / 2)
        return replace(self, freedom=freedom, mirror=mirror)

    def of_followers(self, edge: float) -> Self:
        """Return the constraints of a mesh that follows a stand-in with edges of this length, which has joined it."""
        if self.freedom is None:
            return self
        join = min(self.falloff, _JOIN_EDGES * edge)
        freedom = np.minimum(self.freedom * (self.falloff / join), 1.0) if join > 0 else self.freedom
        return replace(self, freedom=freedom, falloff=join)


UNCONSTRAINED = Constraints()


def freedom_around(mesh: RestMesh, kept: _Flags, falloff: float) -> _Floats:
    """Return the freedom (V,) of the vertices around kept ones, as `Constraints` has it."""
    if falloff <= 0:
        return np.where(kept, 0.0, 1.0)
    distances = surface_distances(mesh, kept, limit=falloff)
    # A vertex that coincides with a kept one is as free as its distance says, but not kept.
    return np.where(kept, 0.0, np.clip(distances / falloff, 1e-12, 1.0))


class Placement:
    """Places the vertices of one mesh.

    `constraints`: of this mesh; handles are not applied here, because they belong to the solve.
    """

    def __init__(self, mesh: RestMesh, constraints: Constraints) -> None:
        self._rest, self._mirror = mesh.verts, constraints.mirror
        free = constraints.freedom
        self._share = None if free is None else torch.from_numpy(free**2 * (3 - 2 * free))[:, None]

    def place(self, points: Tensor) -> Tensor:
        """Return where vertices (V, 3) float64 may be that the variables would move to `points`; differentiable."""
        moved = points - self._rest
        if self._share is not None:
            moved = self._share * moved
        if self._mirror is not None:
            moved = self._mirror.average(moved)
        return self._rest + moved

    def matrix(self, axis: int) -> sparse.csr_matrix:
        """Return the matrix (V, V) that acts on one coordinate of the displacements."""
        count = len(self._rest)
        share = np.ones(count) if self._share is None else self._share.numpy()[:, 0]
        scaled = sparse.diags(share).tocsr()
        return scaled if self._mirror is None else (self._mirror.matrix(axis) @ scaled).tocsr()


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
