"""Per-face Jacobians of a deformation: from positions, and completed to full rank for what needs a normal direction.

A piecewise-linear map of a surface says how edges map; what happens along the normal is free. `jacobians_from_verts`
gives the map's own Jacobian, which sends the rest normal to zero. The optimisation's variables are full 3x3 matrices
that start as identities; the Poisson solve reads only their tangential part. `completed_jacobians` sends the rest unit
normal to the deformed unit normal times the square root of the area ratio, so that a scaling by c comes out as c I.

Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 2.
"""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.mesh import face_areas, face_normals
from meshdeform.operators import gradient_operator

__all__ = ["completed_jacobians", "identity_jacobians", "jacobians_from_verts"]


def identity_jacobians(n_faces: int) -> Tensor:
    """Jacobians (F, 3, 3) float64 of the rest mesh itself: where the optimisation starts."""
    return torch.eye(3, dtype=torch.float64).repeat(n_faces, 1, 1)


def jacobians_from_verts(gradient_operator: Tensor, verts: Tensor) -> Tensor:
    """Per-face Jacobians of the piecewise-linear map rest -> verts.

    Parameters
    ----------
    gradient_operator : sparse (3F, V) float64
        Gradient of the *rest* mesh, 1 / object unit.
    verts : (V, 3) float64
        Deformed positions, object units.

    Returns
    -------
    (F, 3, 3) float64, dimensionless: `edge_new = J @ edge_old`, and J @ rest_normal = 0. Differentiable in `verts`.

    Raises
    ------
    ShapeError
        `verts` has not as many rows as the operator has columns.

    Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 2.
    """
    if verts.ndim != 2 or verts.shape != (gradient_operator.shape[1], 3):
        raise ShapeError(f"expected verts ({gradient_operator.shape[1]}, 3), got {tuple(verts.shape)}")
    return (gradient_operator @ verts).view(-1, 3, 3).mT


def completed_jacobians(rest_verts: Tensor, faces: Tensor, new_verts: Tensor) -> Tensor:
    """Full-rank Jacobians of the deformation rest_verts -> new_verts.

    Parameters
    ----------
    rest_verts, new_verts : (V, 3) float64
    faces : (F, 3) int64

    Returns
    -------
    (F, 3, 3) float64. Tangential part exact: `edge_new = J @ edge_old`. The rest unit normal goes to the deformed unit
    normal times sqrt(new area / rest area): the mean tangential stretch, so similarities come out exactly (a rotation R
    as R, a scaling by c as c I) and the completion never stretches more than the surface does. Faces without rest
    area, for which nothing of this is defined, get the identity; faces that collapsed get no normal part.
    """
    tangential = jacobians_from_verts(gradient_operator(rest_verts, faces), new_verts)
    rest_area, new_area = face_areas(rest_verts, faces), face_areas(new_verts, faces)
    rest_normal, new_normal = face_normals(rest_verts, faces), face_normals(new_verts, faces)
    usable = rest_area > 0
    stretch = torch.sqrt(new_area / torch.where(usable, rest_area, 1.0))
    normal_part = (stretch[:, None] * new_normal)[:, :, None] * rest_normal[:, None, :]
    identity = torch.eye(3, dtype=torch.float64)
    return torch.where(usable[:, None, None], tangential + normal_part, identity)
