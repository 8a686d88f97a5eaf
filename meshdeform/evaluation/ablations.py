"""Run the paper's ablations: the method with one component removed or replaced by its predecessor.

`vertices` optimises the vertices directly instead of Jacobians. `single_views` gives the guidance the four views as
separate pictures, each with its own noise, instead of combining them into one. The others leave out one regulariser.
All other parameters of the run stay the same.

Source: Xu et al. 2024, FusionDeformer, section 5.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from typing import Any, TypeVar

import torch
from torch import Tensor

from meshdeform.deformation.jacobians import jacobians_from_verts
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.guidance.base import Guidance
from meshdeform.rendering.cameras import CameraRange, Cameras, sample_orthogonal_cameras
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.document import ResolvedParams

T = TypeVar("T")

__all__ = ["Ablation", "SingleViews", "VertexDisplacements", "ablated_params", "deformation_of"]


class Ablation(StrEnum):
    """Component that is removed or replaced."""

    VERTICES = "vertices"
    SINGLE_VIEWS = "single_views"
    NO_JACOBIAN = "no_jacobian"
    NO_LAPLACIAN = "no_laplacian"
    NO_NORMAL = "no_normal"


_WEIGHTS: Mapping[Ablation, str] = {
    Ablation.NO_JACOBIAN: "jacobian_reg_weight",
    Ablation.NO_LAPLACIAN: "laplacian_weight",
    Ablation.NO_NORMAL: "normal_weight",
}


def ablated_params(params: ResolvedParams, ablation: Ablation | None) -> ResolvedParams:
    """Return the parameters, with weight 0 for the regulariser that the ablation leaves out."""
    weight = _WEIGHTS.get(ablation) if ablation is not None else None
    return params.model_copy(update={weight: 0.0}) if weight is not None else params


def deformation_of(
    ablation: Ablation | None, mesh: TriangleMesh, guidance: Guidance, params: ResolvedParams, *, device: str = "cpu"
) -> Deformation:
    """Create the deformation of an ablation, or of the unmodified method for None.

    Parameters
    ----------
    ablation : Ablation or None
    mesh, guidance, params, device
        As for `Deformation`; the parameters are those of `ablated_params`.
    """
    parts: dict[str, Any] = {}
    if ablation is Ablation.VERTICES:
        parts["variables"] = VertexDisplacements
    elif ablation is Ablation.SINGLE_VIEWS:
        parts["views"] = SingleViews
    return Deformation(mesh, guidance, params, device=device, **parts)


class VertexDisplacements:
    """One displacement per vertex: ``verts = rest + d``, minus the motion of the centre of mass.

    Displacements follow the gradient at each vertex on its own. The paper's first claim is that Jacobians, integrated
    by the Poisson solve, keep large deformations clean. Implements `deformation.variables.Variables`.

    Parameters
    ----------
    poisson : PoissonSystem
        System of the rest mesh, used for the weights of the centre of mass only.
    """

    def __init__(self, poisson: PoissonSystem) -> None:
        self._rest = poisson.rest
        areas = torch.from_numpy(self._rest.vertex_areas)
        self._shares = areas / areas.sum()
        # So that the normal part does not contribute to ||J - I||^2.
        rest_jacobians = jacobians_from_verts(self._rest.gradient, self._rest.verts)
        self._normal_part = torch.eye(3, dtype=torch.float64) - rest_jacobians
        self.tensors = {"displacements": torch.zeros_like(self._rest.verts, requires_grad=True)}

    def rates(self, translation_rate: float) -> dict[str, float]:  # noqa: ARG002 (components move with their vertices)
        """Return the learning rate's multiple, 1 for the displacements."""
        return {"displacements": 1.0}

    def jacobians(self) -> Tensor:
        """Return the Jacobians of the map from rest, with a normal part that does not contribute to ||J - I||^2."""
        return jacobians_from_verts(self._rest.gradient, self.place()) + self._normal_part

    def rows(self, *, of_face: T, of_vertex: T, of_component: T) -> dict[str, T]:  # noqa: ARG002 (one tensor only)
        """Return the argument for the displacements, which have a row per vertex."""
        return {"displacements": of_vertex}

    def place(self) -> Tensor:
        """Add the displacements to the rest positions."""
        displacements = self.tensors["displacements"]
        return self._rest.verts + displacements - self._shares @ displacements

    def adopt(self, verts: Tensor) -> None:
        """Set the displacements so that `place` gives these positions (V, 3) float64, up to a translation of all."""
        with torch.no_grad():
            self.tensors["displacements"].copy_(verts - self._rest.verts)


class SingleViews:
    """Four views a quarter turn apart, in separate pictures of the size of the combined one.

    Implements `rendering.views.Views`.

    Parameters
    ----------
    bounds : CameraRange
    style : RenderStyle
        Style of a view in the combined picture.
    """

    def __init__(self, bounds: CameraRange, style: RenderStyle) -> None:
        self._bounds = bounds
        self.style = replace(style, view_size=2 * style.view_size)

    def sample(self, generator: torch.Generator, fitting_radius: float) -> Cameras:
        """Draw the cameras of one step."""
        return sample_orthogonal_cameras(self._bounds, generator, fitting_radius)

    def arrange(self, images: Tensor) -> Tensor:
        """Return views (4, S, S, 3) as pictures (4, 3, S, S)."""
        return images.permute(0, 3, 1, 2)
