"""Variables that can take any vertex anywhere, so that tests can break what an optimiser's would keep whole."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.differentiable import jacobians_of
from meshdeform.deformation.regularizers import Regularizers
from meshdeform.deformation.variables import Elements
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.tensors import verts_of


class VertexDisplacements:
    """One displacement per vertex: ``verts = rest + d``, minus the motion of the centre of mass.

    Implements `deformation.variables.Variables`.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self.rest = rest = RestMesh.of(mesh)
        self._places = verts_of(rest)
        areas = torch.from_numpy(rest.vertex_areas)
        self._shares = areas / areas.sum()
        # So that the normal part does not contribute to ||J - I||^2.
        rest_jacobians = jacobians_of(rest.gradient, self._places)
        self._normal_part = torch.eye(3, dtype=torch.float64) - rest_jacobians
        self._regularizers = Regularizers(rest)
        self.elements = Elements.faces_of(rest)
        self.resolution, self.local = 0.0, True
        self.tensors = {"displacements": torch.zeros_like(self._places, requires_grad=True)}

    def begin_step(self, fraction: float) -> None:
        """Do nothing: all vertices are free from the first step on."""

    def jacobians(self) -> Tensor:
        """Return the Jacobians (F, 3, 3) of the map from rest."""
        return jacobians_of(self.rest.gradient, self.solve())

    def solve(self) -> Tensor:
        """Add the displacements to the rest positions."""
        displacements = self.tensors["displacements"]
        return self._places + displacements - self._shares @ displacements

    def verts(self, control: Tensor) -> Tensor:
        """Return the argument: the control points are the vertices."""
        return control

    def jacobian_penalty(self) -> Tensor:
        """Return the mean of ||J - I||^2 of the map from rest, in the planes of the faces."""
        return self._regularizers.jacobian(jacobians_of(self.rest.gradient, self.solve()) + self._normal_part)

    def dirichlet_penalty(self, control: Tensor) -> Tensor:
        """Return the area-weighted mean symmetric Dirichlet energy of the faces."""
        return self._regularizers.dirichlet(control)

    def rows(self, of_element: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return the least value (V,) among the faces at each vertex."""
        return {"displacements": self.elements.least_at_corners(of_element, len(self.rest.verts))}

    def adopt(self, control: Tensor) -> None:
        """Set the displacements so that `solve` gives these positions (V, 3) float64, up to a translation of all."""
        with torch.no_grad():
            self.tensors["displacements"].copy_(control - self._places)
