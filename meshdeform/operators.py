"""Discrete differential operators of the rest mesh, as scipy sparse matrices in float64.

With G the gradient and M the face areas, the cotangent Laplacian is L = G^T M G.

Source: Botsch et al. 2010, Polygon Mesh Processing, section 3.3; Pinkall and Polthier 1993.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from meshdeform.mesh import TriangleMesh

__all__ = [
    "AREA_EPSILON",
    "cotangent_laplacian",
    "effective_face_areas",
    "gradient_operator",
    "mass_matrix",
    "vertex_areas",
]

AREA_EPSILON = 1e-12
"""Faces below this share of the squared bounding box diagonal count as having no area: their weight is zero."""


def effective_face_areas(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Areas (F,) in squared object units, exactly zero for faces too thin to have a gradient."""
    v, f = mesh.verts.numpy(), mesh.faces.numpy()
    a, b, c = v[f[:, 0]], v[f[:, 1]], v[f[:, 2]]
    areas: NDArray[np.float64] = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    used = v[np.unique(f)] if len(f) else v
    diagonal_sq = float(((used.max(0) - used.min(0)) ** 2).sum()) if len(used) else 0.0
    return np.where(areas > AREA_EPSILON * diagonal_sq, areas, 0.0)


def gradient_operator(mesh: TriangleMesh) -> sparse.csr_matrix:
    """Gradient of piecewise-linear functions, (3F, V), 1 / object unit.

    Row 3 f + i maps vertex values to the i-th component of face f's gradient. Faces without area have zero rows.
    """
    v, f = mesh.verts.numpy(), mesh.faces.numpy()
    a, b, c = v[f[:, 0]], v[f[:, 1]], v[f[:, 2]]
    cross = np.cross(b - a, c - a)
    squared = (cross**2).sum(1, keepdims=True)
    solid = effective_face_areas(mesh)[:, None] > 0
    inverse = np.where(solid, 1 / np.where(solid, squared, 1.0), 0.0)
    # grad of corner k's hat function = n x (edge opposite to k) / (2 area), with n / (2 area) = cross / |cross|^2.
    normal = cross * inverse
    hats = np.stack([np.cross(normal, c - b), np.cross(normal, a - c), np.cross(normal, b - a)], axis=2)
    rows = np.repeat(np.arange(3 * len(f)), 3)
    cols = np.repeat(f[:, None, :], 3, axis=1).ravel()
    return sparse.csr_matrix((hats.ravel(), (rows, cols)), shape=(3 * len(f), len(v)))


def mass_matrix(mesh: TriangleMesh) -> sparse.dia_matrix:
    """Face areas on the diagonal, three rows a face: (3F, 3F)."""
    return sparse.diags(np.repeat(effective_face_areas(mesh), 3))


def vertex_areas(mesh: TriangleMesh) -> NDArray[np.float64]:
    """A third of the areas of the faces around each vertex, (V,)."""
    areas = np.repeat(effective_face_areas(mesh) / 3, 3)
    return np.bincount(mesh.faces.numpy().ravel(), weights=areas, minlength=mesh.verts.shape[0]).astype(np.float64)


def cotangent_laplacian(mesh: TriangleMesh) -> sparse.csr_matrix:
    """The positive semi-definite cotangent Laplacian L = G^T M G, (V, V), dimensionless."""
    gradient = gradient_operator(mesh)
    return (gradient.T @ mass_matrix(mesh) @ gradient).tocsr()
