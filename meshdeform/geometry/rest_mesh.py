"""Hold the rest mesh, and compute its areas, operators, edges and components at most once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.geometry.mesh import MeshEdges, TriangleMesh, connected_components, edges_of, face_normals
from meshdeform.geometry.operators import (
    COLLAPSED_SHAPE,
    cotangent_laplacian,
    effective_face_areas,
    gradient_operator,
    vertex_areas,
)

__all__ = ["RestMesh"]


@dataclass(frozen=True)
class RestMesh(TriangleMesh):
    """A triangle mesh that does not move, with operators that are computed on first access.

    Attributes
    ----------
    collapsed_shape : float
        Faces whose area over their longest edge squared is at most this count as collapsed. The Poisson system raises
        it if the matrix cannot be factored otherwise; use the system's `rest` to agree with it.
    """

    collapsed_shape: float = COLLAPSED_SHAPE

    @classmethod
    def of(cls, mesh: TriangleMesh) -> RestMesh:
        """Return the mesh itself if it is a `RestMesh`, otherwise one with the same vertices and faces."""
        return mesh if isinstance(mesh, cls) else cls(mesh.verts, mesh.faces)

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """Areas (F,) in squared object units, zero for collapsed faces."""
        return effective_face_areas(self, collapsed_shape=self.collapsed_shape)

    @cached_property
    def solid(self) -> NDArray[np.bool_]:
        """Flags (F,) of the faces that are not collapsed."""
        return self.areas > 0

    @cached_property
    def normals(self) -> Tensor:
        """Unit normals (F, 3) float64; zero where a face has no area at all."""
        return face_normals(self.verts, self.faces)

    @cached_property
    def vertex_areas(self) -> NDArray[np.float64]:
        """A third of the total area of the faces around each vertex, (V,)."""
        return vertex_areas(self, collapsed_shape=self.collapsed_shape)

    @cached_property
    def gradient(self) -> sparse.csr_matrix:
        """Gradient operator (3F, V), 1 / object unit."""
        return gradient_operator(self, collapsed_shape=self.collapsed_shape)

    @cached_property
    def laplacian(self) -> sparse.csr_matrix:
        """Cotangent Laplacian (V, V), positive semi-definite, dimensionless."""
        return cotangent_laplacian(self, collapsed_shape=self.collapsed_shape)

    @cached_property
    def edges(self) -> MeshEdges:
        """Unique edges with their faces."""
        return edges_of(self.faces)

    @cached_property
    def components(self) -> Tensor:
        """Connected component (V,) int64 of each vertex; an unused vertex is its own component."""
        return connected_components(self.faces, self.verts.shape[0])

    @cached_property
    def num_components(self) -> int:
        """Number of connected components."""
        return int(self.components.max()) + 1 if self.components.numel() else 0

    @cached_property
    def incidence(self) -> sparse.csr_matrix:
        """Incidence matrix (F, V), one where a face has a vertex."""
        count = self.faces.shape[0]
        rows, columns = np.arange(3 * count) // 3, self.faces.numpy().ravel()
        return sparse.csr_matrix((np.ones(3 * count), (rows, columns)), shape=(count, self.verts.shape[0]))

    @cached_property
    def face_adjacency(self) -> sparse.csr_matrix:
        """Adjacency matrix (F, F), nonzero where two faces share a vertex."""
        return (self.incidence @ self.incidence.T).tocsr()

    @cached_property
    def edge_adjacency(self) -> sparse.csr_matrix:
        """Adjacency matrix (F, F), one where two faces share an edge."""
        pairs = self.edges.faces[self.edges.faces[:, 1] >= 0].numpy()
        rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
        count = self.faces.shape[0]
        return sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))

    def centre_of_mass(self) -> Tensor:
        """Return the centroid (3,) of the surface: the mean of the vertices, weighted by their areas."""
        weights = torch.from_numpy(self.vertex_areas)
        if not float(weights.sum()) > 0:
            return self.verts.mean(0)
        return (weights / weights.sum()) @ self.verts
