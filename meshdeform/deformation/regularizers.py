"""Compute the regularisers, which do not depend on mesh resolution or scale.

The published forms are means over faces, vertices and edges, and two of them change with the tessellation: halving
the edges divides the umbrella Laplacian by four and (1 - n_i . n_j)^2 by sixteen. Here each is a discretised integral
over the rest surface of area A:

* jacobian   1/A  sum_f |f| ||J_f - I||^2                       the published mean, weighted by area
* laplacian  1/4pi  sum_v m_v ||(M^-1 L u)_v||^2                 the integral of |Delta u|^2 of the displacement u;
  dimensionless; details of the rest shape cost nothing, only bending relative to it
* normal     1/A  sum_e a_e max(0, g_e(1 - cos t_e) - g_e(1 - cos t_e0))    t_e the signed angle between the normals of
  the two faces, t_e0 at rest (0 where t_e has the other sign); g_e(c) = h(r_e^2 c) + r_e (c^2 - h(c)); r_e = d_0 / d_e,
  d_e the distance between their centroids at rest, d_0 that distance on a uniform mesh of 5,000 faces; a_e the edge's
  share of the area; h(y) = y^2 up to y_0, beyond it 4 sqrt(y_0^3 y) - 3 y_0^2
* dirichlet  1/A  sum_f |f| b log(1 + E_f / b)  with E_f = s_1^2 + s_2^2 + s_1^-2 + s_2^-2 - 4 of the singular values of
  each face's map, in its plane: zero where no length changes, infinite where a face collapses; b = 100, so that a face
  that nearly does outweighs no others. Not in the paper

The normal term is relative to rest: a crease costs nothing unless it becomes sharper than at rest or folds to the other
side. It is the published energy minus its value at rest, so it resists the growth of sharp corners into spikes like the
published term, but does not flatten them. A term in the change of the angle alone was tried: it is weak where a corner
of a cube begins to fold, and the guard then holds back the whole shape.

The term is independent of resolution for both kinds of bending. Under smooth bending, t_e is proportional to d_e and c
to d_e^2: r_e^2 c does not change as the mesh is refined, the a_e add up to the area, and the second part of g is zero.
A crease bends by the same angle at every resolution, while the area beside it shrinks as d_e: there g is r_e c^2 except
for 3 y_0^2 (r_e - 1). At the reference resolution, r_e = 1, the value is exactly the published (1 - n_i . n_j)^2 if the
rest surface is flat.

Sources: Xu et al. 2024, FusionDeformer, eq. 9 to 13; Gao et al. 2023, TextDeformer; Grinspun et al. 2003, Discrete
Shells (bending against rest); Huber 1964, Robust estimation of a location parameter (the change from square to linear);
Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, eq. 2 (symmetric Dirichlet, here less its
minimum).
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.deformation.compiled_penalties import (
    bends,
    crease_energy,
    dirichlet_penalty,
    jacobian_penalty,
    normal_penalty,
    penalty,
)
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.rest_mesh import RestMesh

__all__ = ["REFERENCE_FACES", "Regularizers"]

REFERENCE_FACES = 5000
_MASS_FLOOR = 0.1
_DISTANCE_FLOOR = 0.1

_Floats = NDArray[np.float64]


class Regularizers:
    """Penalties of one rest mesh; every method returns a float64 scalar, differentiable in its argument.

    Parameters
    ----------
    mesh : TriangleMesh
        Faces without area are left out, as are edges of such faces, border edges and edges of more than two faces.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        rest = RestMesh.of(mesh)
        self._faces, self._rest = rest.faces, rest.verts
        total = max(float(rest.areas.sum()), 1e-300)
        self._face_weights = rest.areas / total
        mass = rest.vertex_areas
        used = mass > 0
        # Vertices of needle triangles have almost no mass, and there M^-1 L u is no meaningful curvature.
        floor = _MASS_FLOOR * float(mass[used].mean()) if used.any() else 1.0
        root = sparse.diags(np.where(used, 1 / np.sqrt(np.maximum(mass, floor)), 0.0))
        self._half_operator = (root @ rest.laplacian).tocsr()
        self._transposed = self._half_operator.T.tocsr()
        self._init_edges(rest, torch.from_numpy(rest.areas), total)
        solid = rest.faces[torch.from_numpy(np.flatnonzero(rest.solid))]
        inverse = torch.linalg.inv(_in_plane(rest.verts[solid])).contiguous().numpy()
        self._solid = (solid.numpy(), inverse, self._face_weights[rest.solid])

    def _init_edges(self, mesh: RestMesh, areas: Tensor, total: float) -> None:
        edges = mesh.edges
        # Two faces are neighbours only where exactly two meet and they are not duplicates of each other.
        kept = (edges.counts == 2) & (edges.opposite[:, 0] != edges.opposite[:, 1])
        kept[kept.clone()] = (areas[edges.faces[kept]] > 0).all(1)
        pairs, ends = edges.faces[kept], edges.edges[kept]
        # Neighbours of inconsistent winding have opposite normals where the surface is flat.
        sign = torch.where(edges.consistent[kept], 1.0, -1.0).double()
        around = [tensor.contiguous().numpy() for tensor in (self._faces, pairs, ends, sign)]
        rest_bend = bends(mesh.verts.numpy(), *around)
        centroids = mesh.verts[mesh.faces].mean(1)
        squared = (centroids[pairs[:, 0]] - centroids[pairs[:, 1]]).square().sum(1)
        squared = squared.clamp_min(_DISTANCE_FLOOR * squared.mean() if len(pairs) else 0.0)
        # Centroids of equilateral neighbours of area a are 2/3 of a height apart: d^2 = 4 a / (3 sqrt 3).
        reference_sq = 4 / (3 * math.sqrt(3)) * total / REFERENCE_FACES
        self._edge_scale = scale = (reference_sq / squared).numpy()
        weights = (areas[pairs].sum(1) / 3 / total).numpy()
        rest_energy = crease_energy(np.ascontiguousarray(rest_bend[:, 0]), scale)
        corners, neighbours, shared, sign_of_edge = around
        rest_sine = np.ascontiguousarray(rest_bend[:, 1])
        self._edges = (corners, neighbours, shared, sign_of_edge, rest_sine, rest_energy, weights)

    def jacobian(self, jacobians: Tensor) -> Tensor:
        """Return the area-weighted mean of ||J - I||^2 (squared Frobenius norm) of Jacobians (F, 3, 3)."""
        return penalty(lambda values, gradient: jacobian_penalty(values, self._face_weights, gradient), jacobians)

    def laplacian(self, verts: Tensor) -> Tensor:
        """Return the integral of the squared Laplacian of the displacement of positions (V, 3), divided by 4 pi."""
        return penalty(self._bending, verts)

    def _bending(self, verts: _Floats, gradient: _Floats | None) -> float:
        bent = self._half_operator @ (verts - self._rest.numpy())
        if gradient is not None:
            gradient += self._transposed @ (bent / (2 * math.pi))
        return float((bent * bent).sum() / (4 * math.pi))

    def normal(self, verts: Tensor) -> Tensor:
        """Return the bending of neighbouring faces beyond rest: a dimensionless, area-weighted mean.

        Neighbours are two faces at an edge of no other face; if their winding is inconsistent, one normal is flipped.
        """
        # A face that has collapsed since has a zero normal and a constant cost.
        return penalty(lambda values, gradient: normal_penalty(values, *self._edges, self._edge_scale, gradient), verts)

    def dirichlet(self, verts: Tensor) -> Tensor:
        """Return the mean logarithm of the symmetric Dirichlet energy of positions (V, 3), zero for a rigid motion.

        Dimensionless, weighted by area. With F the face's map in coordinates of its rest plane
        and C = F^T F, the energy is E = tr C + tr C / det C - 4.
        Faces without area at rest are left out.
        """
        return penalty(lambda values, gradient: dirichlet_penalty(values, *self._solid, gradient), verts)


def _in_plane(corners: Tensor) -> Tensor:
    """Return two edges of each triangle (F, 3, 3) as columns of a 2 x 2 matrix, in coordinates of its own plane."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = first.norm(dim=1)
    along = (first * second).sum(1) / length
    across = torch.linalg.cross(first, second).norm(dim=1) / length
    return torch.stack([torch.stack([length, along], 1), torch.stack([torch.zeros_like(length), across], 1)], 1)
