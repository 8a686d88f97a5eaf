"""Transform the asset's normals and tangents by the Jacobians of the faces around each vertex.

Recomputing normals would lose hard edges, custom normals and everything that an artist baked into them. Instead, the
source's normal n at a vertex becomes the direction of ``sum_f |f| cof(J_f) n`` over the faces f around it, with
cof(J) = det(J) J^-T, the map of oriented area elements. Tangents follow J itself and are made perpendicular to the new
normal.

A normal that is averaged over a hard edge follows the mean of maps that may differ much, and can end up behind one of
its faces. `rebuild_turned_normals` replaces those.

Source: Turkowski 1990, Properties of Surface-Normal Transformations.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["rebuild_turned_normals", "transform_normals", "transform_tangents"]

_Floats = NDArray[np.float64]

_ROUNDING = 1e-6
_IN_FRONT = 0.05
"""Cosine to a face from which a source normal counts as on one side of it; a smaller one may change sides."""


def transform_normals(normals: _Floats, triangles: NDArray[np.int64], jacobians: Tensor, areas: Tensor) -> _Floats:
    """Transform the source's normals to the deformed surface.

    Parameters
    ----------
    normals : (N, 3) float64
        Unit normals of the source vertices; NaN rows (no normal) stay NaN.
    triangles : (F, 3) int64
        Source vertices of the faces that have a Jacobian.
    jacobians : (F, 3, 3) float64
        Completed Jacobians.
    areas : (F,) float64
        Weights.

    Returns
    -------
    (N, 3) float64 unit normals. A vertex whose faces all collapse, or that no face uses, keeps its normal. Where
    nothing was deformed, the source's numbers are returned, including the float32 rounding of their length.
    """
    a, b, c = jacobians.unbind(1)
    cofactors = torch.stack([torch.linalg.cross(b, c), torch.linalg.cross(c, a), torch.linalg.cross(a, b)], 1)
    return _transform(normals, triangles, cofactors, areas)


def transform_tangents(
    tangents: _Floats, normals: _Floats, triangles: NDArray[np.int64], jacobians: Tensor, areas: Tensor
) -> _Floats:
    """Transform the source's tangents to the deformed surface, perpendicular to its normals.

    Parameters
    ----------
    tangents : (N, 4) float64
        Unit tangents and handedness; NaN rows stay NaN.
    normals : (N, 3) float64
        The *deformed* normals.
    triangles, jacobians, areas
        As for `transform_normals`.

    Returns
    -------
    (N, 4) float64; the handedness is the source's.
    """
    moved = _transform(tangents[:, :3], triangles, jacobians, areas)
    flat = moved - (moved * normals).sum(1, keepdims=True) * normals
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    usable = length[:, 0] > 1e-12
    direction = np.where(usable[:, None], flat / np.where(length > 1e-12, length, 1.0), moved)
    direction = np.where(np.isnan(normals), moved, direction)
    return np.concatenate([direction, tangents[:, 3:]], 1)


def rebuild_turned_normals(
    normals: _Floats, source_normals: _Floats, triangles: NDArray[np.int64], rest_faces: Tensor, new_faces: Tensor
) -> tuple[_Floats, int]:
    """Replace transformed normals that have changed sides of one of their faces.

    Parameters
    ----------
    normals, source_normals : (N, 3) float64
        Unit normals after and before; NaN rows (no normal) stay NaN.
    triangles : (F, 3) int64
        Source vertices of the faces.
    rest_faces, new_faces : (F, 3) float64
        Area vectors of the faces before and after.

    Returns
    -------
    (N, 3) float64 unit normals, and how many were replaced: by the mean of the deformed area vectors of their faces, on
    the sides where the source's normal was.
    """
    corners = triangles.reshape(-1)
    before, after = (
        np.repeat(torch.nn.functional.normalize(faces, dim=1).numpy(), 3, axis=0) for faces in (rest_faces, new_faces)
    )
    was = (source_normals[corners] * before).sum(1)
    changed = (np.abs(was) > _IN_FRONT) & (np.sign(was) * (normals[corners] * after).sum(1) < 0)
    turned = np.unique(corners[changed])
    if not len(turned):
        return normals, 0
    signed = np.sign(was)[:, None] * np.repeat(new_faces.numpy(), 3, axis=0)
    signed[~np.isfinite(signed)] = 0.0
    mean = np.stack([np.bincount(corners, signed[:, k], len(normals)) for k in range(3)], 1)[turned]
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    usable = length[:, 0] > 0
    rebuilt = normals.copy()
    rebuilt[turned[usable]] = mean[usable] / length[usable]
    return rebuilt, int(usable.sum())


def _transform(vectors: _Floats, triangles: NDArray[np.int64], maps: Tensor, areas: Tensor) -> _Floats:
    weighted = np.repeat((maps * areas[:, None, None]).numpy().reshape(-1, 9), 3, axis=0)
    corners = triangles.reshape(-1)
    total = np.stack([np.bincount(corners, weighted[:, k], len(vectors)) for k in range(9)], 1)
    moved = np.einsum("nij,nj->ni", total.reshape(-1, 3, 3), vectors)
    length = np.linalg.norm(moved, axis=1, keepdims=True)
    scale = np.linalg.norm(total, axis=1, keepdims=True)
    usable = length > 1e-9 * np.maximum(scale, 1e-300)
    # A unit vector rounded to float32 keeps its length, so that it rounds to the same float32 again.
    source_length = np.linalg.norm(vectors, axis=1, keepdims=True)
    wanted = np.where(np.abs(source_length - 1) < _ROUNDING, source_length, 1.0)
    return np.where(usable, moved * (wanted / np.where(usable, length, 1.0)), vectors)
