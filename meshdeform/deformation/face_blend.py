"""Steps taken in part: some faces, with their surroundings, stay nearer to an earlier shape than the rest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.deformation.variables import Variables
from meshdeform.geometry.mesh import TriangleMesh

__all__ = ["FaceBlend"]


class FaceBlend:
    """Sets the variables between two states, face by face.

    Parameters
    ----------
    mesh : TriangleMesh
    variables : Variables

    Attributes
    ----------
    around : (F, F) sparse
        Not zero where two faces share a vertex.
    incidence : (F, V) sparse
        Ones where a face has a vertex.
    """

    def __init__(self, mesh: TriangleMesh, variables: Variables) -> None:
        self._variables = variables
        count, n_verts = mesh.faces.shape[0], mesh.verts.shape[0]
        corner = np.arange(3 * count) // 3
        columns = mesh.faces.numpy().ravel()
        self.incidence = sparse.csr_matrix((np.ones(3 * count), (corner, columns)), shape=(count, n_verts))
        self.around = (self.incidence @ self.incidence.T).tocsr()

    def copy(self) -> dict[str, Tensor]:
        """The variables as they stand."""
        return {name: tensor.detach().clone() for name, tensor in self._variables.tensors.items()}

    def ramp(self, held: NDArray[np.bool_], rings: int) -> NDArray[np.float64]:
        """(F,): 0 on the held faces, then 1 / (rings + 1) more with every ring of faces around them."""
        share = np.ones(len(held))
        reached = held.astype(np.float64)
        share[held] = 0.0
        for ring in range(rings):
            reached = ((self.around @ reached) > 0).astype(np.float64)
            share = np.where(reached > 0, np.minimum(share, (ring + 1) / (rings + 1)), share)
        return share

    @torch.no_grad()
    def between(self, old: Mapping[str, Tensor], new: Mapping[str, Tensor], share: NDArray[np.float64]) -> None:
        """Set the variables between the old state (0) and the new one (1), by a share (F,) for each face.

        Translations stay as they are: components move as a whole.
        """
        of_face = torch.from_numpy(share)
        of_vertex = torch.from_numpy(1 - (self.incidence.T @ (1 - share) > 0))
        rows = {"jacobians": of_face, "displacements": of_vertex}
        for name in rows.keys() & self._variables.tensors.keys():
            tensor, whole = self._variables.tensors[name], old[name]
            tensor.copy_(whole + rows[name].view(-1, *[1] * (tensor.ndim - 1)) * (new[name] - whole))
