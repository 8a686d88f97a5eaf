"""Give the asset's own vertices, which may be split at seams, the shape of the welded mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.assets import Surface
from meshdeform.deformation.jacobians import completed_jacobians
from meshdeform.geometry.mesh import face_cross
from meshdeform.geometry.normals import rebuild_turned_normals, transform_normals, transform_tangents
from meshdeform.geometry.weld import WeldedMesh

__all__ = ["DeformedSurface", "deformed_surface", "vertex_jacobians"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DeformedSurface:
    """New positions (N, 3), normals (N, 3) and tangents (N, 4), rows as in `Surface`.

    Attributes
    ----------
    rebuilt_normals : int
        Normals that had changed sides of a face.
    """

    positions: _Floats
    normals: _Floats
    tangents: _Floats
    rebuilt_normals: int


def vertex_jacobians(welded: WeldedMesh, verts: Tensor) -> _Floats:
    """Return the linear map (N, 3, 3) of a deformation around each of the source's vertices, in world space.

    It is the mean of the completed Jacobians of the faces around the welded vertex, by their area; exactly the identity
    where none of these faces moved, and at vertices that no face uses.

    Parameters
    ----------
    welded : WeldedMesh
    verts : (V, 3) float64
        Deformed welded vertices, in world space.
    """
    rest = welded.mesh
    faces, areas = rest.faces.reshape(-1), torch.from_numpy(rest.areas)
    identity = torch.eye(3, dtype=torch.float64)
    moved = (verts != rest.verts).any(1)[rest.faces].any(1)
    bent = torch.where(moved[:, None, None], completed_jacobians(rest, verts) - identity, 0.0)
    total = torch.zeros(len(rest.verts), 3, 3, dtype=torch.float64)
    total.index_add_(0, faces, (areas[:, None, None] * bent).repeat_interleave(3, 0))
    weight = torch.zeros(len(rest.verts), dtype=torch.float64).index_add_(0, faces, areas.repeat_interleave(3))
    around = (identity + total / weight.clamp_min(1e-300)[:, None, None]).numpy()
    found = np.tile(np.eye(3), (len(welded.vertex_map), 1, 1))
    used = welded.vertex_map >= 0
    found[used] = around[welded.vertex_map[used]]
    return found


def deformed_surface(surface: Surface, welded: WeldedMesh, verts: Tensor) -> DeformedSurface:
    """Move a surface with its welded vertices (V, 3) float64, world space."""
    rest = welded.mesh
    jacobians = completed_jacobians(rest, verts)
    areas = torch.from_numpy(rest.areas)
    triangles = surface.triangles[welded.face_source]
    normals = transform_normals(surface.normals, triangles, jacobians, areas)
    faces = face_cross(rest.verts, rest.faces), face_cross(verts, rest.faces)
    normals, rebuilt = rebuild_turned_normals(normals, surface.normals, triangles, *faces)
    tangents = transform_tangents(surface.tangents, normals, triangles, jacobians, areas)
    # The Jacobian of a face that did not move is the identity but for rounding.
    moved = (verts != rest.verts).any(1)[rest.faces].any(1).numpy()
    still = np.ones(len(normals), bool)
    still[triangles[moved].ravel()] = False
    normals[still], tangents[still] = surface.normals[still], surface.tangents[still]
    return DeformedSurface(welded.scatter(verts, surface.positions), normals, tangents, rebuilt)
