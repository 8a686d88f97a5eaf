"""Represent triangle meshes, and compute their edges, areas, normals and connected components.

Any triangle soup is valid input: open borders, non-manifold edges, zero-area faces, several components. Nothing here
returns NaN for them. The differentiable functions, on torch's tensors, are in `tensors`.

`RestMesh` computes its areas, edges, components and discrete differential operators at most once. The operators are
scipy sparse matrices in float64. The gradient of corner k's hat function on a face with unit normal n, area |f| and
opposite edge e_k is (n x e_k) / (2 |f|). With G these gradients and M the areas, the cotangent Laplacian is L = G^T M
G.

Source: Botsch et al. 2010, Polygon Mesh Processing, section 3.3; Pinkall and Polthier 1993.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.errors import ShapeError
from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.junctions import Junctions

# Squared lengths below this count as zero: no mesh has such edges, and 1 / sqrt is still finite here.
TINY_SQUARE = 1e-280
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class TriangleMesh:
    """Vertices and triangles.

    Raises
    ------
    ShapeError
        A shape or dtype is wrong, or a face refers to a vertex that does not exist.
    """

    verts: _Floats  # (V, 3) float64
    faces: _Index  # (F, 3) int64, counter-clockwise from outside

    def __post_init__(self) -> None:
        if self.verts.ndim != 2 or self.verts.shape[1] != 3 or self.verts.dtype != np.float64:
            raise ShapeError(f"expected verts (V, 3) float64, got {self.verts.shape} {self.verts.dtype}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.faces.dtype != np.int64:
            raise ShapeError(f"expected faces (F, 3) int64, got {self.faces.shape} {self.faces.dtype}")
        if self.faces.size and not (int(self.faces.min()) >= 0 and int(self.faces.max()) < self.verts.shape[0]):
            raise ShapeError("a face refers to a vertex that does not exist")


@dataclass(frozen=True)
class MeshEdges:
    """Unique edges with the first two faces of each."""

    edges: _Index  # (E, 2) int64: end points, smaller index first
    faces: _Index
    """(E, 2) int64: first and second face at the edge; -1 if there is no second one (open borders). Further faces of a
    non-manifold edge are not listed."""
    opposite: _Index  # (E, 2) int64: third vertex of each of these faces, or -1
    counts: _Index  # (E,) int64: number of faces at the edge: 1 at borders, more than 2 where the mesh is not manifold
    consistent: NDArray[np.bool_]
    """(E,) bool: whether the two faces traverse the edge in opposite directions, as consistently oriented neighbours
    do."""


def face_cross(verts: _Floats, faces: _Index) -> _Floats:
    """Return the cross product of two edges per face, (F, 3): along the normal, with twice the area as length."""
    a, b, c = (verts[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def safe_normalize(vectors: _Floats) -> _Floats:
    """Normalise vectors (..., 3); zero vectors stay zero."""
    square = (vectors * vectors).sum(-1, keepdims=True)
    usable = square > TINY_SQUARE
    return np.asarray(vectors * np.where(usable, 1 / np.sqrt(np.where(usable, square, 1.0)), 0.0))


def face_areas(verts: _Floats, faces: _Index) -> _Floats:
    """Return the areas (F,) in squared object units."""
    cross = face_cross(verts, faces)
    square = (cross * cross).sum(-1)
    return np.asarray(0.5 * np.sqrt(np.where(square > TINY_SQUARE, square, 0.0)))


def face_normals(verts: _Floats, faces: _Index) -> _Floats:
    """Return unit normals (F, 3); zero where a face has no area."""
    return safe_normalize(face_cross(verts, faces))


def edges_of(faces: _Index) -> MeshEdges:
    """Find the unique edges of `faces` (F, 3) int64, in ascending order of their end points."""
    if not faces.size:
        none = np.zeros((0, 2), np.int64)
        return MeshEdges(none, none, none, none[:, 0], none[:, 0].astype(bool))
    start, stop = faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()
    opposite = faces.ravel()
    owner = np.repeat(np.arange(len(faces)), 3)
    n = int(faces.max()) + 1
    keys = np.minimum(start, stop) * n + np.maximum(start, stop)
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    first = np.flatnonzero(np.diff(ordered, prepend=-1))
    key, counts = ordered[first], np.diff(first, append=len(order))
    second = np.minimum(first + 1, len(order) - 1)
    pair = np.stack([order[first], np.where(counts > 1, order[second], -1)], 1)
    missing, take = pair < 0, np.maximum(pair, 0)
    forward = (start < stop)[take]
    return MeshEdges(
        np.stack([key // n, key % n], 1),
        np.where(missing, -1, owner[take]),
        np.where(missing, -1, opposite[take]),
        counts,
        (counts > 1) & (forward[:, 0] != forward[:, 1]),
    )


def connected_components(faces: _Index, n_verts: int) -> _Index:
    """Return the component label (V,) int64 of every vertex; an unused vertex is its own component."""
    rows, cols = np.concatenate([faces[:, 0], faces[:, 1]]), np.concatenate([faces[:, 1], faces[:, 2]])
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, cols)), shape=(n_verts, n_verts))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], np.int64)


@dataclass(frozen=True)
class RestMesh(TriangleMesh):
    """A triangle mesh that does not move, with operators that are computed on first access."""

    collapsed_shape: float = COLLAPSED_SHAPE
    """Faces whose area over their longest edge squared is at most this count as collapsed. The Poisson system raises it
    if the matrix cannot be factored otherwise; use the system's `rest` to agree with it."""

    @classmethod
    def of(cls, mesh: TriangleMesh) -> RestMesh:
        """Return the mesh itself if it is a `RestMesh`, otherwise one with the same vertices and faces."""
        return mesh if isinstance(mesh, cls) else cls(mesh.verts, mesh.faces)

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """Areas (F,) in squared object units, exactly zero for collapsed faces: points, lines, thin needles."""
        edges, cross = self._edges_and_crosses
        areas = 0.5 * np.linalg.norm(cross, axis=1)
        longest_sq = (edges**2).sum(2).max(1, initial=0.0)
        return np.where(areas > self.collapsed_shape * longest_sq, areas, 0.0)

    @property
    def _edges_and_crosses(self) -> tuple[_Floats, _Floats]:
        """The edges (F, 3, 3) opposite to each corner, counter-clockwise, and the cross products (F, 3)."""
        corners = self.verts[self.faces]
        edges = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
        return edges, np.cross(edges[:, 1], edges[:, 2])

    @cached_property
    def solid(self) -> NDArray[np.bool_]:
        """Flags (F,) of the faces that are not collapsed."""
        return self.areas > 0

    @cached_property
    def box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The lowest and the highest corner (3,) of the bounding box of the faces."""
        used = self.verts[np.unique(self.faces)]
        return used.min(0), used.max(0)

    @cached_property
    def normals(self) -> _Floats:
        """Unit normals (F, 3) float64; zero where a face has no area at all."""
        return face_normals(self.verts, self.faces)

    @cached_property
    def vertex_areas(self) -> NDArray[np.float64]:
        """A third of the total area of the faces around each vertex, (V,)."""
        areas = np.repeat(self.areas / 3, 3)
        return np.bincount(self.faces.ravel(), weights=areas, minlength=self.verts.shape[0]).astype(np.float64)

    @cached_property
    def gradient(self) -> sparse.csr_matrix:
        """Gradient of piecewise-linear functions, (3F, V), 1 / object unit.

        Row 3 f + i maps vertex values to the i-th component of face f's gradient. Of a collapsed face, the gradient is
        the derivative along its longest edge, its only well-defined direction; a face that is one point has zero rows.
        """
        edges, cross = self._edges_and_crosses
        n_faces, n_verts = len(self.faces), self.verts.shape[0]
        squared = (cross**2).sum(1)
        # n / (2 |f|) is the cross product over its square.
        normal = cross / np.where(self.solid, squared, 1.0)[:, None]
        hats = np.where(self.solid[:, None, None], np.cross(normal[:, None], edges), 0.0)
        lengths_sq = (edges**2).sum(2)
        thin = np.flatnonzero(~self.solid & (lengths_sq.max(1, initial=0.0) > 0))
        longest = lengths_sq[thin].argmax(1) if len(thin) else thin
        along = edges[thin, longest] / lengths_sq[thin, longest][:, None]
        hats[thin, (longest + 2) % 3] = along
        hats[thin, (longest + 1) % 3] = -along
        rows = np.broadcast_to(np.arange(3 * n_faces).reshape(n_faces, 1, 3), hats.shape)
        columns = np.broadcast_to(self.faces[:, :, None], hats.shape)
        return sparse.csr_matrix((hats.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * n_faces, n_verts))

    @cached_property
    def laplacian(self) -> sparse.csr_matrix:
        """Cotangent Laplacian L = G^T M G, (V, V), positive semi-definite, dimensionless."""
        return (self.gradient.T @ sparse.diags(np.repeat(self.areas, 3)) @ self.gradient).tocsr()

    @cached_property
    def edges(self) -> MeshEdges:
        """Unique edges with their faces."""
        return edges_of(self.faces)

    @cached_property
    def components(self) -> _Index:
        """Connected component (V,) int64 of each vertex; an unused vertex is its own component."""
        return connected_components(self.faces, self.verts.shape[0])

    @cached_property
    def num_components(self) -> int:
        """Number of connected components."""
        return int(self.components.max()) + 1 if self.components.size else 0

    @cached_property
    def junctions(self) -> Junctions:
        """Vertices on edges of faces that they are no corner of, which follow those edges."""
        return Junctions.of(self.verts, self.faces)

    @cached_property
    def joined(self) -> NDArray[np.int64]:
        """The connected component (V,) of each vertex, from 0, with those as one that a junction joins."""
        return self.junctions.joined(self.components) if len(self.junctions) else self.components

    @cached_property
    def incidence(self) -> sparse.csr_matrix:
        """Incidence matrix (F, V), one where a face has a vertex."""
        count = self.faces.shape[0]
        rows, columns = np.arange(3 * count) // 3, self.faces.ravel()
        return sparse.csr_matrix((np.ones(3 * count), (rows, columns)), shape=(count, self.verts.shape[0]))

    @cached_property
    def edge_adjacency(self) -> sparse.csr_matrix:
        """Adjacency matrix (F, F), one where two faces share an edge."""
        pairs = self.edges.faces[self.edges.faces[:, 1] >= 0]
        rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
        count = self.faces.shape[0]
        return sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))

    def centre_of_mass(self) -> _Floats:
        """Return the centroid (3,) of the surface: the mean of the vertices, weighted by their areas."""
        weights = self.vertex_areas
        if not float(weights.sum()) > 0:
            return np.asarray(self.verts.mean(0))
        return np.asarray((weights / weights.sum()) @ self.verts)
