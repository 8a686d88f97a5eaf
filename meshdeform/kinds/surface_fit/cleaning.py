"""Make a manifold of a mesh, or say why that is not possible.

Move the vertices of a mesh along its surface, so that slivers become triangles that can be collapsed.

An extracted mesh has slivers wherever the surface passes close to a point of the grid. Collapsing an edge of a sliver
would turn a face over, so a decimation leaves whole regions as dense as they are and takes all it must from the rest:
of a thin torus it made edges twenty times as long as the tube is thick.

Source: Field 1988, Laplacian Smoothing and Delaunay Triangulations; here each vertex is projected back to the surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.errors import AssetEmptyError, AssetError
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
    verts, faces = welded.mesh.verts.numpy(), welded.mesh.faces.numpy()
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
    found = topology(corners, twin)
    if found.components > _MAX_COMPONENTS:
        raise AssetError(
            f"The mesh has {found.components} separate parts; a field can have {_MAX_COMPONENTS}.",
            advice="Send one object at a time, or remove the loose parts.",
        )
    cleaned = {
        "degenerate_faces": welded.skipped["degenerate_faces"],
        "duplicate_faces": int(len(welded.mesh.faces) - len(faces)),
        "non_manifold_edges": int((counts > 2).sum()),
        "reversed_edges": reversed_edges,
        "separated_vertices": len(split) - len(np.unique(faces)),
    }
    return CleanMesh(split, corners, twin, found, cleaned)


def _reversed(faces: _Index) -> int:
    """Return the number of edges of exactly two faces that run along it in the same direction."""
    start, end = faces.ravel(), np.roll(faces, -1, 1).ravel()
    forward = start < end
    pairs = np.stack([np.minimum(start, end), np.maximum(start, end)], 1)
    _, which = np.unique(pairs, axis=0, return_inverse=True)
    which = which.ravel()
    number, ahead = np.bincount(which), np.bincount(which, forward)
    return int(((number == 2) & (ahead != 1)).sum())


_TIMES = 3


def relaxed(mesh: CleanMesh, project: Callable[[_Floats, _Floats], tuple[_Floats, _Floats]]) -> CleanMesh:
    """Return the mesh with each vertex amid its neighbours, on the surface; those of borders stay.

    Parameters
    ----------
    project : callable
        From points (P, 3) and unit normals (P, 3) to places on the surface and normals there.
    """
    verts, faces = mesh.verts, mesh.faces
    start, end = faces.ravel(), np.roll(faces, -1, 1).ravel()
    ones = np.ones(len(start))
    near = sparse.csr_matrix((ones, (start, end)), shape=(len(verts), len(verts)))
    near = near + near.T
    count = np.asarray(near.sum(1)).ravel()
    border = np.zeros(len(verts), np.bool_)
    border[np.concatenate([start[mesh.twin.ravel() < 0], end[mesh.twin.ravel() < 0]])] = True
    for _ in range(_TIMES):
        normals = _normals(verts, faces)
        moved, _ = project(near @ verts / count[:, None], normals)
        verts = np.where(border[:, None], verts, moved)
    return CleanMesh(verts, faces, mesh.twin, mesh.topology, mesh.cleaned)


def _normals(verts: _Floats, faces: NDArray[np.int64]) -> _Floats:
    """Return unit normals (V, 3), means of the faces' by area; zero where they cancel."""
    a, b, c = verts[faces].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    total = np.stack(
        [sum(np.bincount(faces[:, k], cross[:, axis], len(verts)) for k in range(3)) for axis in range(3)], 1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(np.divide(total, length, out=np.zeros_like(total), where=length > 1e-300))
