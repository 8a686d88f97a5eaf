"""What the optimiser moves: one Jacobian for each face, integrated to vertices by the Poisson solve.

A gradient on one face thereby moves the surface around it smoothly and at all scales. The optimisation knows its
variables by the interface `Variables` only, so that an ablation can put others in their place.

Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import torch
from torch import Tensor

from meshdeform.deformation.jacobians import identity_jacobians, jacobians_from_verts
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.errors import CheckpointError
from meshdeform.geometry.mesh import face_normals
from meshdeform.geometry.operators import gradient_operator

__all__ = ["JacobianField", "Variables", "copy_into"]


class Variables(Protocol):
    """The state that an optimiser moves, and the shape that it means."""

    tensors: dict[str, Tensor]
    """Leaves with gradients, float64, by the names that checkpoints use; the first is the one that says the shape."""

    def rates(self, translation_rate: float) -> dict[str, float]:
        """Each tensor's learning rate as a multiple of the job's."""

    def jacobians(self) -> Tensor:
        """(F, 3, 3) float64 that the rigidity of the surface is measured by."""

    def place(self) -> Tensor:
        """Positions (V, 3) float64, differentiable in `tensors`."""

    def adopt(self, verts: Tensor) -> None:
        """Set the variables so that `place` gives these positions (V, 3) float64, up to a motion of the whole."""


class JacobianField:
    """Jacobians, and one translation for each connected component: ``verts = poisson(J) + t_c``.

    Parameters
    ----------
    poisson : PoissonSystem
        Of the rest mesh; the centre of mass of the whole stays where it was.
    """

    def __init__(self, poisson: PoissonSystem) -> None:
        self._poisson = poisson
        areas = torch.zeros(poisson.num_components, dtype=torch.float64)
        areas.index_add_(0, poisson.components, poisson.vertex_areas)
        self._shares = areas / areas.sum()
        self._gradient = gradient_operator(poisson.mesh)
        normals = face_normals(poisson.mesh.verts, poisson.mesh.faces)
        self._along_normal = normals[:, :, None] * normals[:, None, :]
        self._weights = poisson.vertex_areas / areas.clamp_min(1e-300)[poisson.components]
        self.tensors = {
            "jacobians": identity_jacobians(poisson.mesh.faces.shape[0]).requires_grad_(),
            "translations": torch.zeros(poisson.num_components, 3, dtype=torch.float64, requires_grad=True),
        }

    def rates(self, translation_rate: float) -> dict[str, float]:
        """Jacobians at the job's rate, translations at their multiple of it."""
        return {"jacobians": 1.0, "translations": translation_rate}

    def jacobians(self) -> Tensor:
        """The variables themselves."""
        return self.tensors["jacobians"]

    def place(self) -> Tensor:
        """Solve."""
        translations = self.tensors["translations"]
        free = translations - self._shares @ translations
        return self._poisson.solve(self.tensors["jacobians"]) + free[self._poisson.components]

    def adopt(self, verts: Tensor) -> None:
        """The Jacobians of the map from rest; along the normal, where a map of a surface has none, they stay."""
        mesh, components = self._poisson.mesh, self._poisson.components
        with torch.no_grad():
            jacobians = self.tensors["jacobians"]
            of_map = jacobians_from_verts(self._gradient, verts)
            jacobians.copy_(of_map + (jacobians - of_map) @ self._along_normal)
            moved = torch.zeros_like(self.tensors["translations"])
            moved.index_add_(0, components, self._weights[:, None] * (verts - mesh.verts))
            self.tensors["translations"].copy_(moved)


def copy_into(variables: Variables, state: Mapping[str, Tensor]) -> None:
    """Take over the tensors of a checkpoint.

    Raises
    ------
    CheckpointError
        They are of another mesh, or of other variables.
    """
    with torch.no_grad():
        for name, parameter in variables.tensors.items():
            stored = state.get(name)
            if stored is None or stored.shape != parameter.shape:
                raise CheckpointError(f"The checkpoint's {name} do not fit this mesh.")
            parameter.copy_(stored)
