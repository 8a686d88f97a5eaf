"""Constrain where vertices may go: what is kept, what is mirrored, and handles that go to their goals.

The vertices p that the variables give are placed in this order, with d = p - rest::

    d <- s d                  s = 0 where the surface is kept, rising with f = (distance from there) / fall-off as
                              f^2 (3 - 2 f) to 1: displacement and its derivative are continuous
    d <- (d + R P d) / 2      with a mirror: P takes values from the mirror image of each vertex, R reflects
    d <- T d                  with T-junctions: vertices on edges follow them (`junctions.py`)
    v  = rest + d

All of it is linear, and exact: a kept vertex has the bits of the rest shape. Mirrored partners move by mirrored
amounts and a vertex on the plane stays on it, so that the mesh stays as symmetric as at rest, to the last bit of the
displacements.

The distances are lengths along the surface: Dijkstra's algorithm on the edges and on the straight lines that cross an
edge from corner to corner of its two triangles, unfolded into a plane. On an even sphere these paths are at most 5 %
too long.

Handles act before, within the solve (`handles.py`).

Source: Dijkstra 1959, A note on two problems in connexion with graphs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from meshdeform.deformation.binding import corner_normals
from meshdeform.deformation.settings import Rigidity
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.nearest_points import NearestPoints

_JOIN_EDGES = 2.0
"""Edges of a stand-in over which the whole mesh joins what is kept exactly: the stand-in has joined it already."""

_Floats = NDArray[np.float64]
_Flags = NDArray[np.bool_]
TOLERANCE = 1e-4
"""Distance, as a share of the diagonal, up to which a vertex counts as the mirror image of another."""
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class RigidBody:
    """Vertices (n,) int64 of a mesh that keep their shape together."""

    verts: NDArray[np.int64]
    mode: Rigidity = Rigidity.RIGID


@dataclass(frozen=True)
class HandleConstraint:
    """A point of the surface that goes to a goal."""

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
    handles: Sequence[HandleConstraint] = ()

    @property
    def kept(self) -> _Flags | None:
        """Flags (V,) of the vertices that do not move; None if all may."""
        return None if self.freedom is None else self.freedom == 0

    @property
    def changes_start(self) -> bool:
        """Whether the shape at the start may differ from the rest shape."""
        return bool(self.handles)

    def placement(self, mesh: RestMesh) -> VertexPlacement | None:
        """Return the placement of the mesh's vertices; None if only handles constrain them."""
        if self.freedom is None and self.mirror is None and not len(mesh.junctions):
            return None
        return VertexPlacement(mesh, self)

    def of_stand_in(self, simple: RestMesh, whole: RestMesh) -> Self:
        """Return the constraints of a simplified mesh; handles need the whole mesh."""
        freedom, mirror = self.freedom, self.mirror
        if freedom is not None:
            nearest = NearestPoints(whole, simple.verts, corner_normals(simple))
            freedom = nearest.blend(freedom[:, None])[:, 0]
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


class VertexPlacement:
    """Places the vertices of one mesh.

    `constraints`: of this mesh; handles are not applied here, because they belong to the solve.
    """

    def __init__(self, mesh: RestMesh, constraints: Constraints) -> None:
        self._rest, self._mirror = mesh.verts, constraints.mirror
        free = constraints.freedom
        self._share = None if free is None else (free**2 * (3 - 2 * free))[:, None]
        junctions = mesh.junctions if free is None else mesh.junctions.without(free == 0)
        self._follow = junctions.follow if len(junctions) else None

    def place(self, points: _Floats) -> _Floats:
        """Return where vertices (V, 3) float64 may be that would move to `points`."""
        moved = points - self._rest
        if self._share is not None:
            moved = self._share * moved
        if self._mirror is not None:
            moved = self._mirror.average(moved)
        if self._follow is not None:
            moved = self._follow @ moved
        return np.asarray(self._rest + moved)

    def place_transposed(self, gradient: _Floats) -> _Floats:
        """Return the gradient (V, 3) of the points for that of where they are placed."""
        if self._follow is not None:
            gradient = self._follow.T @ gradient
        if self._mirror is not None:
            gradient = self._mirror.average_transposed(gradient)
        return gradient if self._share is None else self._share * gradient

    def matrix(self, axis: int) -> sparse.csr_matrix:
        """Return the matrix (V, V) that acts on one coordinate of the displacements."""
        count = len(self._rest)
        share = np.ones(count) if self._share is None else self._share[:, 0]
        matrix = sparse.diags(share).tocsr()
        if self._mirror is not None:
            matrix = (self._mirror.matrix(axis) @ matrix).tocsr()
        return matrix if self._follow is None else (self._follow @ matrix).tocsr()


@dataclass(frozen=True)
class Partners:
    """The mirrored partner of each vertex."""

    axis: int  # the axis to which the plane is perpendicular; it passes through the middle of the bounding box
    partner: _Index  # (V,) int64: the nearest vertex to each vertex's mirror image
    deviation: float  # greatest distance of a vertex's mirror image from its partner, as a share of the diagonal
    unmatched: int  # vertices without a partner of their own within `TOLERANCE`


def find_partners(mesh: RestMesh, axis: int) -> Partners:
    """Match every vertex with its mirror image across the plane through the middle of the bounding box."""
    points = mesh.verts
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
    def of_partners(cls, partners: Partners) -> Mirror:
        """Return the mirror of a mesh whose vertices all have a partner."""
        count = len(partners.partner)
        rows = np.arange(count + 1)
        return cls(partners.axis, sparse.csr_matrix((np.ones(count), partners.partner, rows), shape=(count, count)))

    @classmethod
    def of_surface(cls, mesh: RestMesh, axis: int, plane: float) -> Mirror:
        """Return the mirror of a mesh whose surface alone is symmetric, at `plane` along the axis."""
        points, normals = mesh.verts.copy(), corner_normals(mesh)
        points[:, axis] = 2 * plane - points[:, axis]
        normals[:, axis] *= -1
        nearest = NearestPoints(mesh, points, normals)
        count = len(points)
        rows = 3 * np.arange(count + 1)
        values, columns = nearest.weights.ravel(), nearest.corners.ravel()
        return cls(axis, sparse.csr_matrix((values, columns, rows), shape=(count, count)))

    def average(self, moved: _Floats) -> _Floats:
        """Return displacements (V, 3) averaged with those of the mirror images."""
        return np.asarray(0.5 * (moved + self._signs * (self.across @ moved)))

    def average_transposed(self, gradient: _Floats) -> _Floats:
        """Return the gradient (V, 3) of displacements for that of their averages."""
        half = 0.5 * gradient
        return np.asarray(half + self.across.T @ (self._signs * half))

    @property
    def _signs(self) -> _Floats:
        signs = np.ones(3)
        signs[self.axis] = -1.0
        return signs

    def matrix(self, axis: int) -> sparse.csr_matrix:
        """Return the matrix (V, V) with which `average` acts on one coordinate."""
        sign = -1.0 if axis == self.axis else 1.0
        return (0.5 * (sparse.identity(self.across.shape[0]) + sign * self.across)).tocsr()


def handle_rows(handles: Sequence[HandleConstraint], count: int) -> sparse.csr_matrix:
    """Return the matrix (H, V) that takes the points of the handles from `count` vertices."""
    owner = np.repeat(np.arange(len(handles)), [len(handle.corners) for handle in handles])
    columns = np.concatenate([np.array(handle.corners, np.int64) for handle in handles])
    values = np.concatenate([np.array(handle.shares) for handle in handles])
    return sparse.csr_matrix((values, (owner, columns)), shape=(len(handles), count))


def surface_distances(mesh: RestMesh, sources: NDArray[np.bool_], *, limit: float = np.inf) -> _Floats:
    """Return the distances (V,) of the vertices from the nearest source along the surface.

    `sources` is (V,) bool. `limit`: greater distances count as infinite, which saves time. Other components are
    infinitely far.
    """
    count = len(sources)
    out = np.full(count, np.inf)
    start = np.flatnonzero(sources)
    if not len(start):
        return out
    ends, lengths = _connections(mesh)
    # Zero would mean that there is no connection; coincident vertices are a negligible distance apart.
    graph = sparse.csr_matrix((np.maximum(lengths, 1e-300), tuple(ends.T)), shape=(count, count))
    distances = csgraph.dijkstra(graph, directed=False, indices=start, min_only=True, limit=limit)
    out[:] = distances
    return out


def _connections(mesh: RestMesh) -> tuple[_Index, _Floats]:
    """Return pairs of vertices (K, 2), each once, and their distances in the plane of their triangles."""
    points, edges = mesh.verts, mesh.edges
    ends = edges.edges
    along = points[ends[:, 1]] - points[ends[:, 0]]
    shared = (edges.counts == 2) & (edges.opposite[:, 0] != edges.opposite[:, 1])
    across, lengths = _unfolded(points, ends[shared], edges.opposite[shared])
    pairs = np.sort(np.concatenate([ends, across]), axis=1)
    distances = np.concatenate([np.linalg.norm(along, axis=1), lengths])
    # A pair may be connected over several edges; its shortest connection counts.
    order = np.lexsort((distances, pairs[:, 1], pairs[:, 0]))
    pairs, distances = pairs[order], distances[order]
    first = np.append(True, (pairs[1:] != pairs[:-1]).any(1)) if len(pairs) else np.zeros(0, bool)
    return pairs[first], distances[first]


def _unfolded(points: _Floats, ends: _Index, opposite: _Index) -> tuple[_Index, _Floats]:
    """Return the opposite corners (K, 2) whose straight line crosses the edge, and its length."""
    base = points[ends[:, 0]]
    edge = points[ends[:, 1]] - base
    length = np.maximum(np.linalg.norm(edge, axis=1), 1e-300)
    arms = points[opposite] - base[:, None]
    along = (arms * edge[:, None]).sum(2) / length[:, None]
    away = np.sqrt(np.maximum((arms**2).sum(2) - along**2, 0.0))
    crossing = (along[:, 0] * away[:, 1] + along[:, 1] * away[:, 0]) / np.maximum(away.sum(1), 1e-300)
    inside = (crossing > 0) & (crossing < length)
    lengths = np.hypot(along[:, 0] - along[:, 1], away.sum(1))
    return opposite[inside], lengths[inside]
