"""Hold the variables of the optimisation: one Jacobian per face, integrated to vertices by the Poisson solve.

This way a gradient on one face moves the surface around it smoothly and at all scales. The optimisation uses its
variables only through the interface `Variables`, so an ablation can substitute others.

Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, TypeVar

import torch
from torch import Tensor

from meshdeform.deformation.jacobians import identity_jacobians, jacobians_from_verts
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.errors import CheckpointError

T = TypeVar("T")

__all__ = ["JacobianField", "Variables", "copy_into"]


class Variables(Protocol):
    """Variables that an optimiser updates, and the shape that they represent."""

    tensors: dict[str, Tensor]
    """Leaf tensors with gradients, float64, by their names in checkpoints; the first one defines the shape."""

    def rates(self, translation_rate: float) -> dict[str, float]:
        """Return each tensor's learning rate as a multiple of the job's."""

    def jacobians(self) -> Tensor:
        """Return the Jacobians (F, 3, 3) float64 that the Jacobian regulariser penalises."""

    def rows(self, *, of_face: T, of_vertex: T, of_component: T) -> dict[str, T]:
        """Return, for each of `tensors`, the argument whose rows correspond to the tensor's rows."""

    def place(self) -> Tensor:
        """Compute the positions (V, 3) float64, differentiable in `tensors`."""

    def adopt(self, verts: Tensor) -> None:
        """Set the variables so that `place` returns these positions (V, 3) float64, up to a translation of all."""


class JacobianField:
    """Jacobians and one translation per connected component: ``verts = poisson(J) + t_c``.

    Parameters
    ----------
    poisson : PoissonSystem
        The system of the rest mesh, whose overall centre of mass stays fixed.
    """

    def __init__(self, poisson: PoissonSystem) -> None:
        self._poisson, self._rest = poisson, poisson.rest
        rest, vertex_areas = poisson.rest, torch.from_numpy(poisson.rest.vertex_areas)
        areas = torch.zeros(rest.num_components, dtype=torch.float64)
        areas.index_add_(0, rest.components, vertex_areas)
        self._shares = areas / areas.sum()
        self._along_normal = rest.normals[:, :, None] * rest.normals[:, None, :]
        self._weights = vertex_areas / areas.clamp_min(1e-300)[rest.components]
        self.tensors = {
            "jacobians": identity_jacobians(rest.faces.shape[0]).requires_grad_(),
            "translations": torch.zeros(rest.num_components, 3, dtype=torch.float64, requires_grad=True),
        }
        self._solved: tuple[int, Tensor] | None = None

    def rates(self, translation_rate: float) -> dict[str, float]:
        """Return the multiples of the job's learning rate: 1 for Jacobians, `translation_rate` for translations."""
        return {"jacobians": 1.0, "translations": translation_rate}

    def jacobians(self) -> Tensor:
        """Return the Jacobians themselves, (F, 3, 3) float64."""
        return self.tensors["jacobians"]

    def rows(self, *, of_face: T, of_vertex: T, of_component: T) -> dict[str, T]:  # noqa: ARG002 (no tensor has a row per vertex)
        """Return the argument for each tensor: Jacobians have a row per face, translations one per component."""
        return {"jacobians": of_face, "translations": of_component}

    def place(self) -> Tensor:
        """Solve for the vertices, and move each component by its translation.

        The solution is reused while the Jacobians do not change: the step limit, the surface guard and the next step's
        loss share it.
        """
        jacobians, translations = self.tensors["jacobians"], self.tensors["translations"]
        known = self._solved[1] if self._solved is not None and self._solved[0] == jacobians._version else None
        solution = self._poisson.solve(jacobians, known)
        if known is None:
            self._solved = (jacobians._version, solution.detach().clone())
        free = translations - self._shares @ translations
        return solution + free[self._rest.components]

    def adopt(self, verts: Tensor) -> None:
        """Set the Jacobians to those of the map from rest; their normal part, which it does not determine, stays."""
        with torch.no_grad():
            jacobians = self.tensors["jacobians"]
            of_map = jacobians_from_verts(self._rest.gradient, verts)
            jacobians.copy_(of_map + (jacobians - of_map) @ self._along_normal)
            moved = torch.zeros_like(self.tensors["translations"])
            moved.index_add_(0, self._rest.components, self._weights[:, None] * (verts - self._rest.verts))
            self.tensors["translations"].copy_(moved)


def copy_into(variables: Variables, state: Mapping[str, Tensor]) -> None:
    """Copy the tensors of a checkpoint into the variables.

    Raises
    ------
    CheckpointError
        The tensors belong to another mesh, or to a run that optimises other variables.
    """
    with torch.no_grad():
        for name, parameter in variables.tensors.items():
            stored = state.get(name)
            if stored is None:
                raise CheckpointError(f"The checkpoint is of a run that does not optimise {name}.")
            if stored.shape != parameter.shape:
                raise CheckpointError(
                    f"The checkpoint is of another mesh: its {name} are {tuple(stored.shape)}, "
                    f"this mesh's {tuple(parameter.shape)}."
                )
            parameter.copy_(stored)
