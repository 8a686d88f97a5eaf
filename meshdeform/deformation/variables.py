"""What the optimiser moves: one Jacobian for each face, integrated to vertices by the Poisson solve.

A gradient on one face thereby moves the surface around it smoothly and at all scales. The optimisation knows its
variables by the interface `Variables` only, so that an ablation can put others in their place.

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
    """The state that an optimiser moves, and the shape that it means."""

    tensors: dict[str, Tensor]
    """Leaves with gradients, float64, by the names that checkpoints use; the first is the one that says the shape."""

    def rates(self, translation_rate: float) -> dict[str, float]:
        """Each tensor's learning rate as a multiple of the job's."""

    def jacobians(self) -> Tensor:
        """(F, 3, 3) float64 that the rigidity of the surface is measured by."""

    def rows(self, *, of_face: T, of_vertex: T, of_component: T) -> dict[str, T]:
        """Return, for each of `tensors`, the one of these that has its rows."""

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
        """Jacobians at the job's rate, translations at their multiple of it."""
        return {"jacobians": 1.0, "translations": translation_rate}

    def jacobians(self) -> Tensor:
        """The variables themselves."""
        return self.tensors["jacobians"]

    def rows(self, *, of_face: T, of_vertex: T, of_component: T) -> dict[str, T]:  # noqa: ARG002 (no tensor has a row a vertex)
        """Jacobians have a row for each face, translations one for each component."""
        return {"jacobians": of_face, "translations": of_component}

    def place(self) -> Tensor:
        """Solve for the vertices, and move each component by its translation.

        Jacobians that have not changed since the last solve are not solved for again: a step's limits, the guard and
        the next step's loss share one solution.
        """
        jacobians, translations = self.tensors["jacobians"], self.tensors["translations"]
        known = self._solved[1] if self._solved is not None and self._solved[0] == jacobians._version else None
        solution = self._poisson.solve(jacobians, known)
        if known is None:
            self._solved = (jacobians._version, solution.detach().clone())
        free = translations - self._shares @ translations
        return solution + free[self._rest.components]

    def adopt(self, verts: Tensor) -> None:
        """The Jacobians of the map from rest; along the normal, where a map of a surface has none, they stay."""
        with torch.no_grad():
            jacobians = self.tensors["jacobians"]
            of_map = jacobians_from_verts(self._rest.gradient, verts)
            jacobians.copy_(of_map + (jacobians - of_map) @ self._along_normal)
            moved = torch.zeros_like(self.tensors["translations"])
            moved.index_add_(0, self._rest.components, self._weights[:, None] * (verts - self._rest.verts))
            self.tensors["translations"].copy_(moved)


def copy_into(variables: Variables, state: Mapping[str, Tensor]) -> None:
    """Take over the tensors of a checkpoint.

    Raises
    ------
    CheckpointError
        They are of another mesh, or of a run that optimises other variables.
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
