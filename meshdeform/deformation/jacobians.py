"""Compute Jacobians of the piecewise-linear map rest -> deformed.

A map of a surface determines how edges are mapped, but not what happens along the normal. Three kinds of Jacobian
follow. That of the map itself sends the rest normal to zero. The optimisation's variables are full 3x3 matrices, of
which the Poisson solve uses the tangential part. Those that transform the asset's normals are completed to full rank.

Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh, face_areas, face_normals

_Floats = NDArray[np.float64]


def jacobians_from_verts(gradient_operator: sparse.csr_matrix, verts: _Floats) -> _Floats:
    """Compute the per-face Jacobians of the piecewise-linear map rest -> verts.

    Parameters
    ----------
    gradient_operator : sparse (3F, V) float64
        Gradient of the *rest* mesh, 1 / object unit.
    verts : (V, 3) float64
        Deformed positions, object units.

    Returns
    -------
    (F, 3, 3) float64, dimensionless: ``edge_new = J @ edge_old`` for the edges of each face. Along the rest normal,
    which the map does not determine, ``J @ n = 0``; `completed_jacobians` fills that direction. Of a collapsed face,
    only the longest edge is mapped.

    Raises
    ------
    ShapeError
        `verts` does not have one row for each column of the operator.
    """
    if verts.shape != (gradient_operator.shape[1], 3):
        raise ShapeError(f"expected verts ({gradient_operator.shape[1]}, 3), got {verts.shape}")
    return np.ascontiguousarray((gradient_operator @ verts).reshape(-1, 3, 3).transpose(0, 2, 1))


def completed_jacobians(mesh: TriangleMesh, verts: _Floats) -> _Floats:
    """Compute Jacobians (F, 3, 3) that also map the rest normal to the deformed one, stretched like the face.

    ``J = J_tangential + sqrt(area_new / area_old) * n_new n_old^T``: the thickness follows the in-plane scale, so a
    uniform scaling by s gives exactly ``s I`` and a rotation exactly the rotation. A face that is collapsed at rest
    gets the identity; one that has lost its area gets no normal part. `mesh`: at rest. Of a `RestMesh`, the operators
    are computed once however often this is called. `verts`, (V, 3) float64: deformed positions.
    """
    rest = RestMesh.of(mesh)
    tangential = jacobians_from_verts(rest.gradient, verts)
    solid = rest.areas > 0
    stretch = np.sqrt(face_areas(verts, rest.faces) / np.where(solid, rest.areas, 1.0))
    n_old, n_new = rest.normals, face_normals(verts, rest.faces)
    normal_part = (stretch[:, None] * n_new)[:, :, None] * n_old[:, None, :]
    return np.where(solid[:, None, None], tangential + normal_part, np.eye(3))
