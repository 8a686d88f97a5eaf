"""Make a manifold of a mesh, or say why that is not possible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetEmptyError, AssetError
from meshdeform.geometry.edge_splits import unique_edges
from meshdeform.geometry.weld import weld
from meshdeform.kinds.surface_fit.gluing import Topology, glue, glued_verts, topology

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_MAX_COMPONENTS = 64
_MOST_REVERSED = 0.01
"""Share of the edges that may run the same way in both faces; they become borders."""


@dataclass(frozen=True)
class CleanMesh:
    """A manifold mesh, possibly with borders."""

    verts: _Floats  # (V, 3) float64
    faces: _Index  # (F, 3) int64
    twin: _Index  # (F, 3) int64: the half-edge glued to each one, -1 at borders
    topology: Topology
    cleaned: dict[str, int]  # what was removed or separated


def clean(positions: _Floats, triangles: _Index) -> CleanMesh:
    """Weld vertices, remove faces that collapsed or occur twice, and separate parts that only touch.

    Parameters
    ----------
    positions : (N, 3) float64
    triangles : (T, 3) int64

    Raises
    ------
    AssetEmptyError
        No face has an area.
    AssetError
        Neighbouring faces contradict each other, or there are more than 64 separate parts.
    """
    welded = weld(positions, triangles)
    verts, faces = welded.mesh.verts, welded.mesh.faces
    _, kept = np.unique(np.sort(faces, 1), axis=0, return_index=True)
    faces = faces[np.sort(kept)]
    if len(faces) < 4:
        raise AssetEmptyError(
            f"The mesh has only {len(faces)} different triangles.", advice="Send a surface of four or more."
        )
    counts = welded.mesh.edges.counts
    twin = glue(verts, faces)
    reversed_edges = _reversed(faces)
    if reversed_edges > _MOST_REVERSED * 1.5 * len(faces):
        raise AssetError(
            f"At {reversed_edges} edges the two faces are turned to opposite sides, so the surface has no outside.",
            advice="Recalculate the normals to the outside (Blender: Mesh, Normals, Recalculate Outside), and export.",
        )
    split, corners = glued_verts(verts, faces, twin)
    problems = topology(corners, twin)
    if problems.components > _MAX_COMPONENTS:
        raise AssetError(
            f"The mesh has {problems.components} separate parts; a field can have {_MAX_COMPONENTS}.",
            advice="Send one object at a time, or remove the loose parts.",
        )
    cleaned = {
        "degenerate_faces": welded.skipped["degenerate_faces"],
        "duplicate_faces": int(len(welded.mesh.faces) - len(faces)),
        "non_manifold_edges": int((counts > 2).sum()),
        "reversed_edges": reversed_edges,
        "separated_vertices": len(split) - len(np.unique(faces)),
    }
    return CleanMesh(split, corners, twin, problems, cleaned)


def _reversed(faces: _Index) -> int:
    """Return the number of edges of exactly two faces that run along it in the same direction."""
    edges, sides = unique_edges(faces)
    which = sides.ravel()
    ahead = np.bincount(which, faces.ravel() == edges[which, 0])
    return int(((np.bincount(which) == 2) & (ahead != 1)).sum())
