"""Make a manifold of a mesh, or say why that is not possible.

Source: Borodin, Zachmann and Klein 2004, Consistent Normal Orientation for Polygonal Meshes (faces that are turned).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

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
    """Weld vertices, remove faces that collapsed or occur twice, turn faces, and separate parts that only touch.

    Parameters
    ----------
    positions : (N, 3) float64
    triangles : (T, 3) int64

    Raises
    ------
    AssetEmptyError
        No face has an area.
    AssetError
        The surface has one side, such as a Moebius strip, or there are more than 64 separate parts.
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
    faces, turned = oriented(verts, faces)
    twin = glue(verts, faces)
    reversed_edges = _reversed(faces)
    if reversed_edges > _MOST_REVERSED * 1.5 * len(faces):
        raise AssetError(
            f"At {reversed_edges} edges the two faces are turned to opposite sides however they are turned, so the "
            "surface has no outside.",
            advice="Cut it where it leads to its own other side, as a Moebius strip does, and export.",
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
        "turned_faces": turned,
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


def oriented(verts: _Floats, faces: _Index) -> tuple[_Index, int]:
    """Return faces (F, 3) that agree with their neighbours wherever they can, and how many were turned.

    Of the two sides of a surface whose faces disagree, the outer one of a closed surface stays, or the one with the
    larger faces of an open one. Neighbours are the two faces of an edge that has no more.
    """
    edges, sides = unique_edges(faces)
    which, count = sides.ravel(), len(faces)
    order = np.argsort(which, kind="stable")
    sizes = np.bincount(which)
    first = (np.cumsum(sizes) - sizes)[sizes == 2]
    one, other = order[first], order[first + 1]
    ahead = faces.ravel() == edges[which, 0]
    against = ahead[one] == ahead[other]
    if not against.any():
        return faces, 0
    # Each face has a number as it is, and one turned; what must be chosen together is connected.
    rows = np.concatenate([one // 3, one // 3 + count])
    columns = np.concatenate([other // 3 + count * against, other // 3 + count * ~against])
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    as_is, turned = csgraph.connected_components(graph, directed=False)[1].reshape(2, count)
    surface, flip = np.minimum(as_is, turned), as_is > turned
    a, b, c = verts[faces].transpose(1, 0, 2) - verts.mean(0)
    sign = np.where(flip, -1.0, 1.0)
    volume = np.bincount(surface, sign * (a * np.cross(b, c)).sum(1))
    area = np.bincount(surface, sign * np.linalg.norm(np.cross(b - a, c - a), axis=1))
    is_open = np.bincount(surface, (sizes[sides] != 2).any(1)) > 0
    flip ^= np.where(is_open, area, volume)[surface] < 0
    # Surfaces whose faces agree stay as they are, and so do those with one side.
    flip &= (np.bincount(surface[one[against] // 3], minlength=len(area)) > 0)[surface] & (as_is != turned)
    return np.where(flip[:, None], faces[:, ::-1], faces), int(flip.sum())
