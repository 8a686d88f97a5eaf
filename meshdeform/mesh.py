"""Triangle meshes: normals, areas, edges with their neighbourhood, connected components.

Everything here takes any triangle soup: open borders, non-manifold edges, zero-area faces and several components are
normal input, and nothing below ever gives a NaN or a NaN gradient for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.sparse import coo_matrix, csgraph
from torch import Tensor

from meshdeform.errors import ShapeError

__all__ = [
    "MeshEdges",
    "TriangleMesh",
    "connected_components",
    "edges_of",
    "face_areas",
    "face_cross",
    "face_normals",
    "safe_normalize",
]

# Squared lengths below this are taken for zero: 1e-280 is far from any mesh and its reciprocal root is still finite.
_TINY_SQUARE = 1e-280


@dataclass(frozen=True)
class TriangleMesh:
    """A triangle soup with shared vertices.

    Attributes
    ----------
    verts : (V, 3) float64
        Positions, object units.
    faces : (F, 3) int64
        Corner indices, counter-clockwise seen from outside.

    Raises
    ------
    ShapeError
        A wrong shape, a wrong dtype, an index out of range, or a position that is not finite.
    """

    verts: Tensor
    faces: Tensor

    def __post_init__(self) -> None:
        if self.verts.ndim != 2 or self.verts.shape[1] != 3 or self.verts.dtype != torch.float64:
            raise ShapeError(f"expected verts (V, 3) float64, got {tuple(self.verts.shape)} {self.verts.dtype}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.faces.dtype != torch.int64:
            raise ShapeError(f"expected faces (F, 3) int64, got {tuple(self.faces.shape)} {self.faces.dtype}")
        if self.faces.numel() and (int(self.faces.min()) < 0 or int(self.faces.max()) >= self.n_verts):
            raise ShapeError(f"faces name vertices outside 0..{self.n_verts - 1}")
        if not bool(torch.isfinite(self.verts).all()):
            raise ShapeError("verts must be finite; drop or repair the NaN and infinite rows first")

    @property
    def n_verts(self) -> int:
        """Number of vertices, referenced or not."""
        return int(self.verts.shape[0])

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return int(self.faces.shape[0])

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal over all vertices, object units; 0 for an empty mesh."""
        if not self.n_verts:
            return 0.0
        return float((self.verts.amax(0) - self.verts.amin(0)).norm())


def safe_normalize(vectors: Tensor) -> Tensor:
    """Unit vectors (..., 3); zero vectors stay zero and get a zero gradient (no NaN, no huge one)."""
    square = (vectors * vectors).sum(-1, keepdim=True)
    usable = square > _TINY_SQUARE
    return vectors * torch.where(usable, torch.rsqrt(torch.where(usable, square, 1.0)), 0.0)


def face_cross(verts: Tensor, faces: Tensor) -> Tensor:
    """Cross product of two edges (F, 3) of each face: its normal times twice its area. Differentiable."""
    corners = verts.index_select(0, faces.reshape(-1)).view(-1, 3, 3)
    return torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def face_normals(verts: Tensor, faces: Tensor) -> Tensor:
    """Unit normals of the faces.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64

    Returns
    -------
    (F, 3) float64; the zero vector, with a zero gradient, where a face has no area.
    """
    return safe_normalize(face_cross(verts, faces))


def face_areas(verts: Tensor, faces: Tensor) -> Tensor:
    """Areas (F,) float64 of the faces, square object units; the gradient of a zero area is zero."""
    cross = face_cross(verts, faces)
    square = (cross * cross).sum(-1)
    usable = square > _TINY_SQUARE
    return 0.5 * torch.where(usable, torch.sqrt(torch.where(usable, square, 1.0)), 0.0)


def connected_components(faces: Tensor, n_verts: int) -> Tensor:
    """Label the vertices by connected component; vertices of one face are connected.

    Parameters
    ----------
    faces : (F, 3) int64
    n_verts : int

    Returns
    -------
    (V,) int64, labels 0, 1, ... in the order of each component's first vertex. A vertex without a face is a
    component of its own.
    """
    corners = faces.cpu().numpy()
    start, stop = corners[:, [0, 1]].reshape(-1), corners[:, [1, 2]].reshape(-1)
    graph = coo_matrix((np.ones(start.size, np.int8), (start, stop)), shape=(n_verts, n_verts))
    _, labels = csgraph.connected_components(graph, directed=False)
    # scipy promises no order of its labels; a report and a checkpoint want one.
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(first.size, np.int64)
    rank[np.argsort(first)] = np.arange(first.size)
    return torch.from_numpy(rank[inverse.reshape(-1)])


@dataclass(frozen=True)
class MeshEdges:
    """Unique edges and what lies beside them.

    Attributes
    ----------
    edges : (E, 2) int64
        End points, the smaller index first, in lexicographic order.
    faces : (E, 2) int64
        First two faces at the edge, -1 where there is no second one (open borders).
    opposite : (E, 2) int64
        Those faces' vertex opposite to the edge, -1 where there is none.
    counts : (E,) int64
        How many faces meet at the edge: 1 at a border, 2 inside, more where it is not manifold.
    consistent : (E,) bool
        The two faces traverse the edge in opposite directions, as neighbours of one orientation do.
    """

    edges: Tensor
    faces: Tensor
    opposite: Tensor
    counts: Tensor
    consistent: Tensor


def edges_of(faces: Tensor) -> MeshEdges:
    """Find the unique edges of (F, 3) int64 faces; the faces of an edge are listed in ascending order."""
    start, stop = faces[:, [1, 2, 0]].reshape(-1), faces[:, [2, 0, 1]].reshape(-1)
    opposite = faces.reshape(-1)
    owner = torch.arange(faces.shape[0], device=faces.device).repeat_interleave(3)
    low, high = torch.minimum(start, stop), torch.maximum(start, stop)
    n = int(faces.max()) + 1 if faces.numel() else 1
    key, inverse, counts = torch.unique(low * n + high, return_inverse=True, return_counts=True)
    order = torch.argsort(inverse, stable=True)
    first = counts.cumsum(0) - counts
    second = (first + 1).clamp_max(max(order.numel() - 1, 0))
    pair = torch.stack([order[first], torch.where(counts > 1, order[second], -1)], 1)
    take = pair.clamp_min(0)
    missing = pair < 0
    forward = (start < stop)[take]
    return MeshEdges(
        torch.stack([torch.div(key, n, rounding_mode="floor"), key % n], 1),
        torch.where(missing, -1, owner[take]),
        torch.where(missing, -1, opposite[take]),
        counts,
        (counts > 1) & (forward[:, 0] != forward[:, 1]),
    )
