"""Weld the vertices that a file splits at texture and normal seams, and carry the result back to every one of them.

glTF stores one vertex for every combination of position, normal and texture coordinate. Solved as it stands, the
surface would tear along every seam. The rest mesh is therefore welded by position, deformed, and scattered back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.mesh import TriangleMesh, edges_of, face_areas

__all__ = ["WELD_TOLERANCE", "WeldedMesh", "weld"]

WELD_TOLERANCE = 1e-6
"""Vertices nearer than this fraction of the bounding box's diagonal are one."""


@dataclass(frozen=True)
class WeldedMesh:
    """A mesh without seams, and where its parts came from.

    Attributes
    ----------
    verts : (V, 3) float64
        Each the position of the first source vertex that was welded into it, unchanged.
    faces : (F, 3) int64
        Triangles with three different welded vertices, in source order.
    vertex_map : (N,) int64
        Welded vertex of each source vertex, -1 for source vertices that no triangle refers to.
    face_source : (F,) int64
        Source triangle of each face.
    skipped : dict of str to int
        `degenerate_faces` (left out of the mesh: two corners are one vertex) and `unreferenced_verts` (keep their
        place). What is kept but is no clean manifold: `zero_area_faces` (no weight in the solve), `duplicate_faces`,
        `border_edges`, `nonmanifold_edges`. And `welded_verts`, how many source vertices were merged away.
    """

    verts: Tensor
    faces: Tensor
    vertex_map: Tensor
    face_source: Tensor
    skipped: dict[str, int]

    @property
    def mesh(self) -> TriangleMesh:
        """The rest mesh."""
        return TriangleMesh(self.verts, self.faces)

    def scatter(self, new_verts: Tensor, positions: ArrayLike) -> NDArray[np.float64]:
        """Move every source vertex as its welded vertex moved.

        Parameters
        ----------
        new_verts : (V, 3) float64
            Deformed welded positions.
        positions : (N, 3)
            The source positions that were welded.

        Returns
        -------
        (N, 3) float64. Unreferenced vertices keep their place; offsets below the weld tolerance survive, so an
        undeformed mesh comes back bit for bit.
        """
        if new_verts.shape != self.verts.shape:
            raise ShapeError(f"expected new_verts {tuple(self.verts.shape)}, got {tuple(new_verts.shape)}")
        source = np.array(positions, np.float64)
        target = self.vertex_map.numpy()
        referenced = target >= 0
        index = target[referenced]
        rest, moved = self.verts.numpy()[index], new_verts.detach().cpu().numpy()[index]
        offset = source[referenced] - rest
        source[referenced] = moved + offset
        return source


def weld(
    positions: ArrayLike | Tensor, triangles: ArrayLike | Tensor, *, tolerance: float = WELD_TOLERANCE
) -> WeldedMesh:
    """Merge vertices at the same place.

    Exact duplicates are merged first. Of the rest, each vertex joins the earliest kept vertex within the tolerance;
    since only kept vertices attract, chains of near vertices do not collapse a fine detail into one point.

    Parameters
    ----------
    positions : (N, 3)
        Finite source positions, object units.
    triangles : (T, 3)
        Source corner indices.
    tolerance : float
        Fraction of the diagonal of the referenced vertices' bounding box.

    Raises
    ------
    ShapeError
        Wrong shapes, an index out of range, or positions that are not finite.
    """
    points = np.ascontiguousarray(positions, np.float64)
    corners = np.ascontiguousarray(triangles, np.int64).reshape(-1, 3)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"expected positions (N, 3), got {points.shape}")
    if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
        raise ShapeError(f"triangles name vertices outside 0..{len(points) - 1}")
    referenced = np.unique(corners)
    used = points[referenced]
    if not np.isfinite(used).all():
        raise ShapeError("positions must be finite; drop or repair the NaN and infinite rows first")
    keeper = _keepers(used, tolerance)
    kept, label = np.unique(keeper, return_inverse=True)
    vertex_map = np.full(len(points), -1, np.int64)
    vertex_map[referenced] = label.reshape(-1)
    all_faces = vertex_map[corners]
    a, b, c = all_faces.T
    distinct = (a != b) & (b != c) & (c != a)
    faces = torch.from_numpy(all_faces[distinct])
    verts = torch.from_numpy(used[kept])
    edges = edges_of(faces)
    skipped = {
        "degenerate_faces": int((~distinct).sum()),
        "zero_area_faces": int((face_areas(verts, faces) == 0).sum()),
        "duplicate_faces": len(faces) - len(np.unique(np.sort(faces.numpy(), axis=1), axis=0)),
        "unreferenced_verts": len(points) - len(referenced),
        "welded_verts": len(referenced) - len(kept),
        "border_edges": int((edges.counts == 1).sum()),
        "nonmanifold_edges": int((edges.counts > 2).sum()),
    }
    return WeldedMesh(verts, faces, torch.from_numpy(vertex_map), torch.from_numpy(np.flatnonzero(distinct)), skipped)


def _keepers(points: NDArray[np.float64], tolerance: float) -> NDArray[np.int64]:
    """For each point the index of the point that it is merged into (itself where it is kept)."""
    if not len(points):
        return np.empty(0, np.int64)
    keeper = _first_of_each(points + 0.0)  # + 0.0: -0 and 0 are the same place
    reach = tolerance * float(np.linalg.norm(np.ptp(points, axis=0)))
    if reach <= 0 or not np.isfinite(reach):
        return keeper
    # One point a cell first: it bounds the number of pairs that the tree can find, whatever the input.
    cell = np.rint((points - points.min(0)) / reach)
    keeper = _first_of_each(cell)[keeper]
    kept = np.unique(keeper)
    pairs = cKDTree(points[kept]).query_pairs(reach, output_type="ndarray")
    if not len(pairs):
        return keeper
    moved = np.arange(len(points))
    for low, high in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]:
        i, j = kept[low], kept[high]
        if moved[i] == i and moved[j] == j:
            moved[j] = i
    return moved[keeper]


def _first_of_each(rows: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the first row equal to each row."""
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first[inverse.reshape(-1)]
