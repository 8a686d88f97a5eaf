"""Let losses on the pictures reach only a part of the variables, each its own.

With a share a_g in 0 .. 1 for each loss l_g and each face f, the variables get::

    sum_g a_g(f) d l_g / d J_f

A face with a share of 0 gets nothing of a loss, exactly. It still moves with its surroundings, as far as the solve
takes it along. The cells of a lattice, and the faces of a stand-in, have the shares of the nearest places on the
surface.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.variables import Variables
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.places import NearestPlaces

_Floats = NDArray[np.float64]


class RegionalGradients:
    """Gradients of several losses, of which each reaches a part of the surface.

    Parameters
    ----------
    shares : sequence of (F,) float64
        One for each loss: the share of its gradient that each face of the mesh gets.
    mesh : RestMesh
        The whole mesh, at rest.
    variables : Variables
        Of this mesh or of its stand-in.
    """

    def __init__(self, shares: Sequence[_Floats], mesh: RestMesh, variables: Variables) -> None:
        self._variables = variables
        nearest = _nearest_faces(mesh, variables)
        chosen = shares if nearest is None else [of_face[nearest] for of_face in shares]
        self._shares = [torch.from_numpy(np.ascontiguousarray(of_row))[:, None, None] for of_row in chosen]

    def of(self, losses: Sequence[Tensor]) -> Tensor:
        """Return the sum of the gradients on the Jacobians (E, 3, 3); the graph of the losses is kept."""
        jacobians = self._variables.jacobians()
        total = torch.zeros_like(jacobians)
        for loss, share in zip(losses, self._shares, strict=True):
            total += share * torch.autograd.grad(loss, jacobians, retain_graph=True)[0]
        return total

    def add(self, gradient: Tensor) -> None:
        """Give the variables a gradient on the Jacobians, beside others; the graph is kept."""
        self._variables.jacobians().backward(gradient, retain_graph=True)  # type: ignore[no-untyped-call]


def _nearest_faces(mesh: RestMesh, variables: Variables) -> NDArray[np.int64] | None:
    """Return the face of the mesh that is nearest to each row of the variables; None if they are its faces."""
    if isinstance(variables, LatticeField):
        lattice = variables.lattice
        middles = lattice.origin + (lattice.cells + 0.5) * lattice.spacing
        return NearestPlaces(mesh, middles, np.zeros_like(middles)).faces
    drawn = variables.rest
    if drawn.faces.shape == mesh.faces.shape:
        return None
    middles = drawn.verts[drawn.faces].mean(1).numpy()
    return NearestPlaces(mesh, middles, drawn.normals.numpy()).faces
