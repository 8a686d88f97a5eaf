"""Differentiate the solution of a factored linear system, for the systems of a surface and of a lattice."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

__all__ = ["LinearSystem", "solve_linear"]

_Floats = NDArray[np.float64]


class LinearSystem(Protocol):
    """A linear map from Jacobians to positions, and its transpose."""

    def _forward(self, jacobians: _Floats) -> _Floats:
        """Return the positions (N, 3) for Jacobians (E, 3, 3)."""

    def _backward(self, gradient: _Floats) -> _Floats:
        """Return the gradient (E, 3, 3) for a gradient (N, 3) on the positions."""


def solve_linear(system: LinearSystem, jacobians: Tensor, known: Tensor | None = None) -> Tensor:
    """Return the system's positions (N, 3) float64, differentiable once in the Jacobians.

    Parameters
    ----------
    system : LinearSystem
    jacobians : (E, 3, 3) float64
    known : (N, 3) float64, optional
        The positions, if they have already been computed; then only the gradient is computed.
    """
    result: Tensor = _Solve.apply(system, jacobians, known)  # type: ignore[no-untyped-call]
    return result


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, system: LinearSystem, jacobians: Tensor, known: Tensor | None) -> Tensor:
        ctx.system = system  # type: ignore[attr-defined]
        if known is not None:
            return known.clone()
        return torch.from_numpy(system._forward(jacobians.detach().numpy()))

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[None, Tensor, None]:
        system: LinearSystem = ctx.system  # type: ignore[attr-defined]
        return None, torch.from_numpy(system._backward(gradient.numpy())), None
