"""Represent triangle meshes, and compute their edges, areas, normals and connected components.

Any triangle soup is valid input: open borders, non-manifold edges, zero-area faces, several components. Nothing here
returns NaN, or a NaN or huge gradient, for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy import sparse
from scipy.sparse import csgraph
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

# Squared lengths below this count as zero: no mesh has such edges, and 1 / sqrt is still finite here.
_TINY_SQUARE = 1e-280


@dataclass(frozen=True)
class TriangleMesh:
    """Vertices and triangles.

    Attributes
    ----------
    verts : (V, 3) float64 Tensor on the CPU
    faces : (F, 3) int64 Tensor on the CPU, counter-clockwise from outside

    Raises
    ------
    ShapeError
        A shape or dtype is wrong, or a face refers to a vertex that does not exist.
    """

    verts: Tensor
    faces: Tensor

    def __post_init__(self) -> None:
        if self.verts.ndim != 2 or self.verts.shape[1] != 3 or self.verts.dtype != torch.float64:
            raise ShapeError(f"expected verts (V, 3) float64, got {tuple(self.verts.shape)} {self.verts.dtype}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.faces.dtype != torch.int64:
            raise ShapeError(f"expected faces (F, 3) int64, got {tuple(self.faces.shape)} {self.faces.dtype}")
        if self.faces.numel() and not (int(self.faces.min()) >= 0 and int(self.faces.max()) < self.verts.shape[0]):
            raise ShapeError("a face refers to a vertex that does not exist")


@dataclass(frozen=True)
class MeshEdges:
    """Unique edges with the first two faces of each.

    Attributes
    ----------
    edges : (E, 2) int64
        End points, smaller index first.
    faces : (E, 2) int64
        First and second face at the edge; -1 if there is no second one (open borders). Further faces of a
        non-manifold edge are not listed.
    opposite : (E, 2) int64
        Third vertex of each of these faces, or -1.
    counts : (E,) int64
        Number of faces at the edge: 1 at borders, more than 2 where the mesh is not manifold.
    consistent : (E,) bool
        Whether the two faces traverse the edge in opposite directions, as consistently oriented neighbours do.
    """

    edges: Tensor
    faces: Tensor
    opposite: Tensor
    counts: Tensor
    consistent: Tensor


def face_cross(verts: Tensor, faces: Tensor) -> Tensor:
    """Return the cross product of two edges per face, (F, 3): along the normal, with twice the area as length."""
    # One index_select, not three fancy indexings: its backward pass is several times faster.
    a, b, c = verts.index_select(0, faces.reshape(-1)).view(-1, 3, 3).unbind(1)
    cross: Tensor = torch.linalg.cross(b - a, c - a)
    return cross


def safe_normalize(vectors: Tensor) -> Tensor:
    """Normalise vectors (..., 3); zero vectors stay zero and get a zero gradient."""
    square = (vectors * vectors).sum(-1, keepdim=True)
    usable = square > _TINY_SQUARE
    scale: Tensor = torch.where(usable, torch.rsqrt(torch.where(usable, square, 1.0)), 0.0)
    return vectors * scale


def face_areas(verts: Tensor, faces: Tensor) -> Tensor:
    """Return the areas (F,) in squared object units; the gradient of a zero area is zero."""
    cross = face_cross(verts, faces)
    square = (cross * cross).sum(-1)
    usable = square > _TINY_SQUARE
    doubled: Tensor = torch.where(usable, torch.where(usable, square, 1.0).sqrt(), 0.0)
    return 0.5 * doubled


def face_normals(verts: Tensor, faces: Tensor) -> Tensor:
    """Return unit normals (F, 3); zero, with a zero gradient, where a face has no area."""
    return safe_normalize(face_cross(verts, faces))


def edges_of(faces: Tensor) -> MeshEdges:
    """Find the unique edges of `faces` (F, 3) int64, in ascending order of their end points."""
    if not faces.numel():
        none = torch.zeros(0, 2, dtype=torch.int64, device=faces.device)
        return MeshEdges(none, none, none, none[:, 0], none[:, 0].bool())
    start, stop = faces[:, [1, 2, 0]].reshape(-1), faces[:, [2, 0, 1]].reshape(-1)
    opposite = faces.reshape(-1)
    owner = torch.arange(faces.shape[0], device=faces.device).repeat_interleave(3)
    low, high = torch.minimum(start, stop), torch.maximum(start, stop)
    n = int(faces.max()) + 1
    key, inverse, counts = torch.unique(low * n + high, return_inverse=True, return_counts=True)
    order = torch.argsort(inverse, stable=True)
    first = counts.cumsum(0) - counts
    second = (first + 1).clamp_max(order.numel() - 1)
    pair = torch.stack([order[first], torch.where(counts > 1, order[second], -1)], 1)
    missing, take = pair < 0, pair.clamp_min(0)
    forward = (start < stop)[take]
    return MeshEdges(
        torch.stack([torch.div(key, n, rounding_mode="floor"), key % n], 1),
        torch.where(missing, -1, owner[take]),
        torch.where(missing, -1, opposite[take]),
        counts,
        (counts > 1) & (forward[:, 0] != forward[:, 1]),
    )


def connected_components(faces: Tensor, n_verts: int) -> Tensor:
    """Return the component label (V,) int64 of every vertex; an unused vertex is its own component."""
    f = faces.numpy()
    rows, cols = np.concatenate([f[:, 0], f[:, 1]]), np.concatenate([f[:, 1], f[:, 2]])
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, cols)), shape=(n_verts, n_verts))
    _, labels = csgraph.connected_components(graph, directed=False)
    return torch.from_numpy(labels.astype(np.int64))
