"""Weld the vertices that an asset splits at UV and normal seams, and scatter the result back to them.

The solve needs a connected surface; the file needs all of its own vertices. `weld` merges vertices at the same position
(within a millionth of the diagonal) and records the welded vertex of each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetEmptyError
from meshdeform.geometry.coincidence import WELD_TOLERANCE, coincident
from meshdeform.geometry.mesh import RestMesh, TriangleMesh


@dataclass(frozen=True)
class WeldedMesh:
    """The rest mesh and its relation to the source."""

    mesh: RestMesh  # the faces, and the welded vertices that they use
    vertex_map: NDArray[np.int64]  # (N,) int64: welded vertex of each source vertex; -1 for unused source vertices
    face_source: NDArray[np.int64]  # (F,) int64: source triangle of each face
    skipped: dict[str, int]
    """Counts of what the solve leaves out or treats specially: `unreferenced_vertices`, `degenerate_faces` (two corners
    are welded together), `zero_area_faces`, `non_manifold_edges`, `border_edges`."""

    def scatter(self, verts: NDArray[np.float64], source_positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Move every source vertex by the displacement of its welded vertex; unused vertices do not move.

        Vertices that were a rounding error apart therefore stay so, and a deformation that moves nothing returns the
        source's numbers exactly. `verts`, (V, 3) float64: deformed positions of the welded vertices; `source_positions`
        is (N, 3) float64. Returns (N, 3) float64.
        """
        moved = verts - self.mesh.verts
        out = source_positions.copy()
        used = self.vertex_map >= 0
        out[used] += moved[self.vertex_map[used]]
        return out

    def gather(self, source_positions: NDArray[np.float64]) -> TriangleMesh:
        """Return the mesh with the positions of the source vertices; of merged ones the first counts.

        Parameters
        ----------
        source_positions : (N, 3) float64
            The source vertices in any pose or shape.
        """
        return TriangleMesh(source_positions[self.first_rows()], self.mesh.faces)

    def first_rows(self) -> NDArray[np.int64]:
        """Return the first source vertex (V,) of each welded one."""
        rows = np.zeros(len(self.mesh.verts), np.int64)
        used = np.flatnonzero(self.vertex_map >= 0)[::-1]  # the first of the merged vertices is assigned last
        rows[self.vertex_map[used]] = used
        return rows


def weld(
    positions: NDArray[np.float64], triangles: NDArray[np.int64], *, left_out: NDArray[np.bool_] | None = None
) -> WeldedMesh:
    """Merge vertices that coincide and drop faces that degenerate; the others keep their order.

    Parameters
    ----------
    positions : (N, 3) float64
        Finite, in object units.
    triangles : (T, 3) int64
    left_out : (T,) bool, optional
        Triangles that are left out of the mesh; they share no vertex with the others.

    Raises
    ------
    AssetEmptyError
        No triangle with an area is left.
    """
    chosen = np.ones(len(triangles), bool) if left_out is None else ~left_out
    used = np.unique(triangles[chosen])
    if not len(used):
        raise AssetEmptyError("The asset has no triangles.")
    points = positions[used].astype(np.float64)
    representative = coincident(points, WELD_TOLERANCE * float(np.linalg.norm(points.max(0) - points.min(0))))
    merged = np.full(len(positions), -1, np.int64)
    merged[used] = representative
    corners = merged[triangles]
    solid = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
    solid &= chosen
    kept, faces = np.unique(corners[solid], return_inverse=True)
    renumber = np.full(len(points), -1, np.int64)
    renumber[kept] = np.arange(len(kept))
    vertex_map = np.where(merged >= 0, renumber[np.maximum(merged, 0)], -1)
    mesh = RestMesh(points[kept], faces.reshape(-1, 3).astype(np.int64))
    areas = mesh.areas
    if not (areas > 0).any():
        raise AssetEmptyError("Every triangle of the asset has zero area.", advice="Send a mesh with a surface.")
    counts = mesh.edges.counts
    skipped = {
        "unreferenced_vertices": int((vertex_map < 0).sum()),
        "degenerate_faces": int((~solid & chosen).sum()),
        "zero_area_faces": int((areas == 0).sum()),
        "non_manifold_edges": int((counts > 2).sum()),
        "border_edges": int((counts == 1).sum()),
    }
    return WeldedMesh(mesh, vertex_map.astype(np.int64), np.flatnonzero(solid).astype(np.int64), skipped)
