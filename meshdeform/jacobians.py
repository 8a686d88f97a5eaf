"""Per-face Jacobians of the piecewise-linear map rest -> deformed.

Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 2.
"""

from __future__ import annotations

import torch
from scipy import sparse
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.mesh import face_areas, face_normals

__all__ = ["completed_jacobians", "identity_jacobians", "jacobians_from_verts"]


def identity_jacobians(n_faces: int) -> Tensor:
    """The Jacobians of the map that moves nothing, (F, 3, 3) float64."""
    return torch.eye(3, dtype=torch.float64).repeat(n_faces, 1, 1)


def jacobians_from_verts(gradient_operator: sparse.csr_matrix, verts: Tensor) -> Tensor:
    """Per-face Jacobians of the piecewise-linear map rest -> verts.

    Parameters
    ----------
    gradient_operator : sparse (3F, V) float64
        Gradient of the *rest* mesh, 1 / object unit.
    verts : (V, 3) float64
        Deformed positions, object units.

    Returns
    -------
    (F, 3, 3) float64, dimensionless: ``edge_new = J @ edge_old`` for the edges of each face. The map says nothing
    along the rest normal, where ``J @ n = 0``; `completed_jacobians` fills that direction.

    Raises
    ------
    ShapeError
        `verts` has not as many rows as the operator has columns.
    """
    if verts.shape != (gradient_operator.shape[1], 3):
        raise ShapeError(f"expected verts ({gradient_operator.shape[1]}, 3), got {tuple(verts.shape)}")
    gradients = torch.from_numpy(gradient_operator @ verts.detach().numpy())
    return gradients.view(-1, 3, 3).mT.contiguous()


def completed_jacobians(rest_verts: Tensor, verts: Tensor, faces: Tensor) -> Tensor:
    """Jacobians (F, 3, 3) that also map the rest normal to the deformed one, stretched like the face.

    ``J = J_tangential + sqrt(area_new / area_old) * n_new n_old^T``: the thickness follows the in-plane scale, so a
    uniform scaling by s gives exactly ``s I`` and a rotation exactly the rotation. The identity where a face has no
    area before or after.

    Parameters
    ----------
    rest_verts, verts : (V, 3) float64
    faces : (F, 3) int64
    """
    old = torch.stack(
        [rest_verts[faces[:, 1]] - rest_verts[faces[:, 0]], rest_verts[faces[:, 2]] - rest_verts[faces[:, 0]]], 2
    )
    new = torch.stack([verts[faces[:, 1]] - verts[faces[:, 0]], verts[faces[:, 2]] - verts[faces[:, 0]]], 2)
    area_old, area_new = face_areas(rest_verts, faces), face_areas(verts, faces)
    n_old, n_new = face_normals(rest_verts, faces), face_normals(verts, faces)
    solid = (area_old > 1e-14 * area_old.mean()) & (area_new > 1e-14 * area_new.mean())
    stretch = torch.where(solid, area_new / torch.where(solid, area_old, 1.0), 1.0).sqrt()
    frame_old = torch.cat([old, n_old[:, :, None]], 2)
    frame_new = torch.cat([new, (stretch[:, None] * n_new)[:, :, None]], 2)
    identity = torch.eye(3, dtype=verts.dtype).expand_as(frame_old)
    frame_old = torch.where(solid[:, None, None], frame_old, identity)
    frame_new = torch.where(solid[:, None, None], frame_new, identity)
    return torch.linalg.solve(frame_old.mT, frame_new.mT).mT
