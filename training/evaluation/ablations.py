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
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.orientation import Front
from meshdeform.deformation.poisson import jacobians_from_verts
from meshdeform.deformation.regularizers import Regularizers
from meshdeform.deformation.variables import Elements
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.guidance.base import Guidance
from meshdeform.rendering.cameras import CameraRange
from meshdeform.rendering.shading import OrthogonalGrid, RenderStyle
from meshdeform.requests.document import ResolvedParams


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
    ablation: Ablation | None,
    mesh: TriangleMesh,
    guidance: Guidance,
    params: ResolvedParams,
    *,
    front: Front | None = None,
    device: str = "cpu",
) -> Deformation:
    """Create the deformation of an ablation, or of the unmodified method for None.

    Parameters
    ----------
    ablation : Ablation or None
    mesh, guidance, params, front, device
        As for `Deformation`; the parameters are those of `ablated_params`.
    """
    parts: dict[str, Any] = {}
    if ablation is Ablation.VERTICES:
        parts["variables"] = VertexDisplacements
    elif ablation is Ablation.SINGLE_VIEWS:
        parts["views"] = SingleViews
    return Deformation(mesh, guidance, params, front=front, device=device, **parts)


class VertexDisplacements:
    """One displacement per vertex: ``verts = rest + d``, minus the motion of the centre of mass.

    Displacements follow the gradient at each vertex on its own. The paper's first claim is that Jacobians, integrated
    by the Poisson solve, keep large deformations clean. Implements `deformation.variables.Variables`.

    Parameters
    ----------
    mesh : TriangleMesh
        At rest.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self.rest = rest = RestMesh.of(mesh)
        areas = torch.from_numpy(rest.vertex_areas)
        self._shares = areas / areas.sum()
        # So that the normal part does not contribute to ||J - I||^2.
        rest_jacobians = jacobians_from_verts(rest.gradient, rest.verts)
        self._normal_part = torch.eye(3, dtype=torch.float64) - rest_jacobians
        self._regularizers = Regularizers(rest)
        self.elements = Elements.faces_of(rest)
        self.resolution, self.local = 0.0, True
        self.tensors = {"displacements": torch.zeros_like(rest.verts, requires_grad=True)}

    def begin_step(self, fraction: float) -> None:
        """Do nothing: all vertices are free from the first step on."""

    def jacobians(self) -> Tensor:
        """Return the Jacobians (F, 3, 3) of the map from rest."""
        return jacobians_from_verts(self.rest.gradient, self.solve())

    def solve(self) -> Tensor:
        """Add the displacements to the rest positions."""
        displacements = self.tensors["displacements"]
        return self.rest.verts + displacements - self._shares @ displacements

    def verts(self, control: Tensor) -> Tensor:
        """Return the argument: the control points are the vertices."""
        return control

    def jacobian_penalty(self) -> Tensor:
        """Return the mean of ||J - I||^2 of the map from rest, in the planes of the faces."""
        return self._regularizers.jacobian(jacobians_from_verts(self.rest.gradient, self.solve()) + self._normal_part)

    def dirichlet_penalty(self, control: Tensor) -> Tensor:
        """Return the area-weighted mean symmetric Dirichlet energy of the faces."""
        return self._regularizers.dirichlet(control)

    def rows(self, of_element: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return the least value (V,) among the faces at each vertex."""
        return {"displacements": self.elements.least_at_corners(of_element, len(self.rest.verts))}

    def adopt(self, control: Tensor) -> None:
        """Set the displacements so that `solve` gives these positions (V, 3) float64, up to a translation of all."""
        with torch.no_grad():
            self.tensors["displacements"].copy_(control - self.rest.verts)


class SingleViews(OrthogonalGrid):
    """Four views a quarter turn apart, in separate pictures of the size of the combined one.

    Parameters
    ----------
    bounds : CameraRange
    style : RenderStyle
        Style of a view in the combined picture.
    """

    def __init__(self, bounds: CameraRange, style: RenderStyle) -> None:
        super().__init__(bounds, replace(style, view_size=2 * style.view_size))

    def arrange(self, images: Tensor) -> Tensor:
        """Return views (4, S, S, 3) as pictures (4, 3, S, S)."""
        return images.permute(0, 3, 1, 2)
