"""Make the base: a coarse manifold mesh with the topology of the surface.

fast-simplification collapses edges by their quadric error. It does not test the link condition, so an edge may occur
twice in its result, between different pairs of faces. Such an edge is split at its middle, which leaves the surface
as it is and makes the vertices of every edge unique.

Where slivers keep edges from being collapsed, the mesh is relaxed first (`cleaning.relaxed`).

Source: Garland and Heckbert 1997; Dey et al. 1999, Topology Preserving Edge Contraction (the link condition).
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.errors import AssetError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.simplify import simplified
from meshdeform.kinds.surface_fit.cleaning import CleanMesh, relaxed
from meshdeform.kinds.surface_fit.gluing import fans, glue, topology
from meshdeform.kinds.surface_fit.surface_sources import MeshSurface

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_NEAR = 1.1
"""Times the faces that were asked for: more are a sign of slivers."""
_MOST = 4
"""Times the faces that were asked for, at most."""
_GROWTH = (1.0, 1.01, 1.03, 1.06, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0)


def base_of(surface: CleanMesh, count: int) -> tuple[_Floats, _Index]:
    """Return the vertices (V, 3) float64 and faces (F, 3) int64 of a base of about `count` faces.

    It has more faces if fewer would change the topology. A surface that has no more faces is its own base.

    Raises
    ------
    AssetError
        No base of up to four times as many faces has the topology of the surface.
    """
    if surface.topology.fewest_faces > _MOST * count:
        raise _no_base(count, f"which need {surface.topology.fewest_faces} or more")
    if len(surface.faces) <= count:
        found = _with_unique_edges(surface.verts, surface.faces)
        if found is not None:
            return found
    found = _collapsed(surface, count)
    if found is not None and len(found[1]) <= _NEAR * count:
        return found
    for mesh in (relaxed(surface, MeshSurface(surface).project), surface):
        for factor in _GROWTH:
            if int(count * factor) >= len(surface.faces):
                break
            found = _collapsed(mesh, int(count * factor))
            if found is not None:
                return found
    found = _with_unique_edges(surface.verts, surface.faces) if len(surface.faces) <= _MOST * count else None
    if found is None:
        raise _no_base(count)
    return found


def _no_base(count: int, why: str = "") -> AssetError:
    return AssetError(
        f"No base mesh of {count} to {_MOST * count} faces has the holes and parts of the surface{why and ', '}{why}.",
        advice="Set params.base_faces higher, or remove tiny handles and loose parts. A grid with noise, and points "
        "whose normals face anywhere, have hundreds of them.",
    )


def _collapsed(surface: CleanMesh, count: int) -> tuple[_Floats, _Index] | None:
    """Return a mesh of about `count` faces with the topology of the surface; None if collapses changed it."""
    coarse = simplified(TriangleMesh(torch.from_numpy(surface.verts), torch.from_numpy(surface.faces)), count)
    if not len(coarse.faces):
        return None
    found = _with_unique_edges(coarse.verts.numpy(), coarse.faces.numpy())
    return found if found is not None and topology(found[1], glue(*found)).like(surface.topology) else None


def _with_unique_edges(verts: _Floats, faces: _Index) -> tuple[_Floats, _Index] | None:
    """Split edges that occur twice, and return vertices and faces; None if the mesh is not a manifold."""
    most = max(4, len(faces) // 50)
    for _ in range(most + 1):
        start, end = faces.ravel(), np.roll(faces, -1, 1).ravel()
        pairs = np.stack([np.minimum(start, end), np.maximum(start, end)], 1)
        _, which, counts = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
        many = np.flatnonzero(counts > 2)
        if not len(many):
            fewest, _ = fans(faces, glue(verts, faces))
            return (verts, faces) if fewest == len(np.unique(faces)) == len(verts) else None
        edges = np.flatnonzero(which.ravel() == many[0])
        forward = edges[start[edges] == start[edges[0]]]
        backward = edges[start[edges] != start[edges[0]]]
        if len(forward) != 2 or len(backward) != 2 or len(many) > most:
            return None
        # Only one way of gluing the four faces has one fan around each end; the other would tear the surface.
        splits = [_split(verts, faces, int(forward[0]), int(other)) for other in backward]
        verts, faces = min(splits, key=lambda found: fans(found[1], glue(*found))[0])
    return None


def _split(verts: _Floats, faces: _Index, forward: int, backward: int) -> tuple[_Floats, _Index]:
    """Split the edge of two half-edges at its middle, and with it their faces."""
    a, b = faces.ravel()[forward], np.roll(faces, -1, 1).ravel()[forward]
    middle = len(verts)
    added = []
    faces = faces.copy()
    for edge in (forward, backward):
        face, k = divmod(edge, 3)
        second = faces[face].copy()
        second[k] = middle
        faces[face, (k + 1) % 3] = middle
        added.append(second)
    return np.concatenate([verts, (verts[[a]] + verts[[b]]) / 2]), np.concatenate([faces, np.array(added)])
