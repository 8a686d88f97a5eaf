"""Differentiate solves and placements, which are computed without torch, for an optimiser.

All of them are linear, so each has a gradient that is exact: its transpose.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.deformation.constraints import VertexPlacement
from meshdeform.errors import ShapeError
from meshdeform.geometry.tensors import sparse_product

_Floats = NDArray[np.float64]


class LinearSystem(Protocol):
    """A linear map from Jacobians to positions, and its transpose."""

    def solve(self, jacobians: _Floats) -> _Floats:
        """Return the positions (N, 3) for Jacobians (E, 3, 3)."""

    def solve_transposed(self, gradient: _Floats) -> _Floats:
        """Return the gradient (E, 3, 3) for a gradient (N, 3) on the positions."""


def solve_linear(system: LinearSystem, jacobians: Tensor, known: Tensor | None = None) -> Tensor:
    """Return the system's positions (N, 3) float64, differentiable once in the Jacobians.

    `jacobians` is (E, 3, 3) float64. `known`, (N, 3) float64: the positions, if they have already been computed; then
    only the gradient is computed. Raises what `solve` of the system does.
    """
    result: Tensor = _Solve.apply(system, jacobians, known)  # type: ignore[no-untyped-call]
    return result


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, system: LinearSystem, jacobians: Tensor, known: Tensor | None) -> Tensor:
        ctx.system = system  # type: ignore[attr-defined]
        if known is not None:
            return known.clone()
        return torch.from_numpy(system.solve(jacobians.detach().numpy()))

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[None, Tensor, None]:
        system: LinearSystem = ctx.system  # type: ignore[attr-defined]
        return None, torch.from_numpy(system.solve_transposed(gradient.numpy())), None


def placed_by(placement: VertexPlacement, points: Tensor) -> Tensor:
    """Return where vertices (V, 3) float64 may be that the variables would move to `points`; differentiable once."""
    result: Tensor = _Place.apply(placement, points)  # type: ignore[no-untyped-call]
    return result


class _Place(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, placement: VertexPlacement, points: Tensor) -> Tensor:
        ctx.placement = placement  # type: ignore[attr-defined]
        return torch.from_numpy(placement.place(points.detach().numpy()))

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[None, Tensor]:
        placement: VertexPlacement = ctx.placement  # type: ignore[attr-defined]
        return None, torch.from_numpy(placement.place_transposed(gradient.numpy()))


def jacobians_of(gradient_operator: sparse.csr_matrix, verts: Tensor) -> Tensor:
    """Return `jacobians.jacobians_from_verts`, (F, 3, 3) float64, differentiable once in the vertices (V, 3)."""
    if verts.shape != (gradient_operator.shape[1], 3):
        raise ShapeError(f"expected verts ({gradient_operator.shape[1]}, 3), got {tuple(verts.shape)}")
    return sparse_product(gradient_operator, verts).view(-1, 3, 3).mT.contiguous()


def identity_jacobians(n_faces: int) -> Tensor:
    """Return the identity Jacobian of each face, (F, 3, 3) float64."""
    return torch.eye(3, dtype=torch.float64).repeat(n_faces, 1, 1)
