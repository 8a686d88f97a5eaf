"""What keeps the asset itself: penalties that mean the same at every mesh resolution and every scale.

The published forms are means over faces, vertices and edges, and two of them change with the tessellation: halving
the edges divides the umbrella Laplacian by four and (1 - n_i . n_j)^2 by sixteen. Here each is a
discretised integral over the rest surface of area A:

* jacobian   1/A  sum_f |f| ||J_f - I||^2                       the published mean, weighted by area
* laplacian  1/4pi  sum_v m_v ||(M^-1 L u)_v||^2                 the integral of |Delta u|^2 of the displacement u;
  it has no unit, and a detail of the rest shape costs nothing, only its bending away from where it was
* normal     1/A  sum_e a_e ((1 - n_i . n_j) (d_0 / d_e)^2)^2    with d_e the distance between the faces' centroids
  at rest, a_e the edge's share of the area, and d_0 that distance on a uniform mesh of 5,000 faces, where the value is
  exactly the published one
* dirichlet  1/A  sum_f |f| (s_1^2 + s_2^2 + s_1^-2 + s_2^-2 - 4)  of the singular values of each face's map, in its
  plane: zero where no length changes, infinite where a face collapses. Not in the paper; `barrier.py` keeps steps from
  jumping across

Sources: Xu et al. 2024, FusionDeformer, eq. 7 to 9; Gao et al. 2023, TextDeformer; Grinspun et al. 2003, Discrete
Shells; Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, eq. 2 (symmetric Dirichlet, here less
its minimum).
"""

from __future__ import annotations

import math

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh, edges_of, face_normals
from meshdeform.geometry.operators import cotangent_laplacian, effective_face_areas, sparse_product, vertex_areas

__all__ = ["REFERENCE_FACES", "Regularizers"]

REFERENCE_FACES = 5000
_MASS_FLOOR = 0.1
_DISTANCE_FLOOR = 0.1
_LEAST_DETERMINANT = 1e-16
"""Of C = F^T F, squared area ratios: below an area ratio of 1e-8 the energy goes on as if it were that."""


class Regularizers:
    """The penalties of one rest mesh; every method gives a float64 scalar, differentiable in its argument.

    Parameters
    ----------
    mesh : TriangleMesh
        Faces without area do not count, nor edges beside such faces, at borders or of more than two faces.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self._faces = mesh.faces
        self._rest = mesh.verts
        areas = effective_face_areas(mesh)
        total = max(float(areas.sum()), 1e-300)
        self._face_weights = torch.from_numpy(areas / total)
        mass = vertex_areas(mesh)
        used = mass > 0
        # Needle triangles have vertices of nearly no mass, and there M^-1 is no sensible curvature.
        floor = _MASS_FLOOR * float(mass[used].mean()) if used.any() else 1.0
        root = sparse.diags(np.where(used, 1 / np.sqrt(np.maximum(mass, floor)), 0.0))
        self._half_operator = (root @ cotangent_laplacian(mesh)).tocsr()
        self._init_edges(mesh, torch.from_numpy(areas), total)
        self._solid = torch.from_numpy(np.flatnonzero(areas > 0))
        self._inverse_rest = torch.linalg.inv(_in_plane(mesh.verts[mesh.faces[self._solid]]))

    def _init_edges(self, mesh: TriangleMesh, areas: Tensor, total: float) -> None:
        edges = edges_of(mesh.faces)
        # Which two faces continue each other is known only where exactly two meet, and not where one doubles the other.
        keep = (edges.counts == 2) & (edges.opposite[:, 0] != edges.opposite[:, 1])
        keep[keep.clone()] = (areas[edges.faces[keep]] > 0).all(1)
        pairs = edges.faces[keep]
        self._pairs = pairs
        # Neighbours wound against each other have opposite normals where the surface is flat.
        self._sign = torch.where(edges.consistent[keep], 1.0, -1.0).double()
        centroids = mesh.verts[mesh.faces].mean(1)
        squared = (centroids[pairs[:, 0]] - centroids[pairs[:, 1]]).square().sum(1)
        squared = squared.clamp_min(_DISTANCE_FLOOR * squared.mean() if len(pairs) else 0.0)
        # Equilateral triangles of area a have centroids 2/3 of a height apart across an edge: d^2 = 4 a / (3 sqrt 3).
        reference_sq = 4 / (3 * math.sqrt(3)) * total / REFERENCE_FACES
        self._edge_scale = reference_sq / squared
        self._edge_weights = areas[pairs].sum(1) / 3 / total

    def jacobian(self, jacobians: Tensor) -> Tensor:
        """Area-weighted mean ||J - I||^2 (squared Frobenius norm) of (F, 3, 3) Jacobians."""
        rigid = torch.eye(3, dtype=jacobians.dtype)
        return (self._face_weights * (jacobians - rigid).square().sum((1, 2))).sum()

    def laplacian(self, verts: Tensor) -> Tensor:
        """Integral of the squared Laplacian of the displacement of (V, 3) positions, over 4 pi; zero at rest."""
        bent = sparse_product(self._half_operator, verts - self._rest)
        return bent.square().sum() / (4 * math.pi)

    def normal(self, verts: Tensor) -> Tensor:
        """Area-weighted mean (1 - n_i . n_j)^2 over neighbouring faces, at the reference resolution.

        Neighbours are faces that alone share an edge; where they are wound against each other, one normal is turned.
        """
        normals = face_normals(verts, self._faces)
        beside = normals.index_select(0, self._pairs.reshape(-1)).view(-1, 2, 3)
        # Against 1 and not against |n|^2: a face that collapsed on the way has a zero normal and costs a constant.
        cosine = self._sign * (beside[:, 0] * beside[:, 1]).sum(1)
        return (self._edge_weights * ((1 - cosine) * self._edge_scale).square()).sum()

    def dirichlet(self, verts: Tensor) -> Tensor:
        """Area-weighted mean symmetric Dirichlet energy of (V, 3) positions, less that of a motion; no unit.

        With F the face's map in coordinates of its rest plane and C = F^T F: tr C + tr C / det C - 4. Faces without
        area at rest do not count.
        """
        corners = verts.index_select(0, self._faces[self._solid].reshape(-1)).view(-1, 3, 3)
        edges = torch.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], 2)
        mapped = edges @ self._inverse_rest
        metric = mapped.mT @ mapped
        trace = metric[:, 0, 0] + metric[:, 1, 1]
        determinant = metric[:, 0, 0] * metric[:, 1, 1] - metric[:, 0, 1] * metric[:, 1, 0]
        energy = trace + trace / determinant.clamp_min(_LEAST_DETERMINANT) - 4
        mean: Tensor = (self._face_weights[self._solid] * energy).sum()
        return mean


def _in_plane(corners: Tensor) -> Tensor:
    """Two edges of each triangle (F, 3, 3) as the columns of a 2 x 2 matrix, in coordinates of its own plane."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = first.norm(dim=1)
    along = (first * second).sum(1) / length
    across = torch.linalg.cross(first, second).norm(dim=1) / length
    return torch.stack([torch.stack([length, along], 1), torch.stack([torch.zeros_like(length), across], 1)], 1)
