"""The Poisson solve: from per-face Jacobians to vertices, factored once, differentiable, one gauge a component.

    min_v  sum_f |f| ||grad_f(v) - J_f||^2     <=>     L v = G^T M J,   L = G^T M G

L's kernel are the constants on each connected component: one vertex of each is grounded for the factorisation and the
component is then moved so that its centre of mass is the rest mesh's. The matrix is symmetric, so the backward pass
reuses the same factor. Source: Aigerman et al. 2022, Neural Jacobian Fields, eq. 4.

The factorisation is SuperLU in its symmetric mode (scipy, BSD); `bench/poisson.py` compares it with QDLDL.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.errors import NumericalError, ShapeError
from meshdeform.mesh import TriangleMesh, connected_components
from meshdeform.operators import effective_face_areas, gradient_operator, vertex_areas

__all__ = ["PoissonSystem"]

_SHIFTS = (0.0, 1e-12, 1e-9)
"""Diagonal shifts, relative to the mean diagonal, tried in turn where needle triangles break the factorisation."""


class PoissonSystem:
    """The factored system of one rest mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        Any input: open, non-manifold, of several components, with unused vertices (they keep their place) and faces
        without area (they have no weight).

    Attributes
    ----------
    components : (V,) int64
        Component of each vertex, as faces with area connect them.
    num_components : int
    vertex_areas : (V,) float64
        Weights of the centre of mass.
    shift : float
        The relative diagonal shift that the factorisation needed; 0 for anything but the worst meshes.

    Raises
    ------
    NumericalError
        The matrix could not be factored.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh
        areas = effective_face_areas(mesh)
        self.components = connected_components(mesh.faces[torch.from_numpy(areas > 0)], mesh.verts.shape[0])
        self.num_components = int(self.components.max()) + 1 if self.components.numel() else 0
        self.vertex_areas = torch.from_numpy(vertex_areas(mesh))
        gradient = gradient_operator(mesh)
        self._divergence = (gradient.T @ sparse.diags(np.repeat(areas, 3))).tocsr()
        self._divergence_t = self._divergence.T.tocsr()
        self._free = _ungrounded(self.components.numpy())
        self._laplacian = (self._divergence @ gradient).tocsr()[self._free][:, self._free]
        self._factor, self.shift = _factorise(self._laplacian)
        # A component without area (one unused vertex) weighs its vertices alike.
        weights = self.vertex_areas.numpy()
        labels = self.components.numpy()
        totals = np.bincount(labels, weights, self.num_components)
        counts = np.bincount(labels, minlength=self.num_components)
        solid = totals[labels] > 0
        shares = np.where(solid, weights / np.where(solid, totals[labels], 1.0), 1.0 / counts[labels])
        n = len(labels)
        self._mean = sparse.csr_matrix((shares, (labels, np.arange(n))), shape=(self.num_components, n))
        self._rest_centres = self._mean @ mesh.verts.numpy()

    def solve(self, jacobians: Tensor) -> Tensor:
        """Vertices whose gradients fit the Jacobians best, each component's centre of mass where it was at rest.

        Parameters
        ----------
        jacobians : (F, 3, 3) float64
            ``edge_new = J @ edge_old``.

        Returns
        -------
        (V, 3) float64, object units. Differentiable in `jacobians`.

        Raises
        ------
        ShapeError
            One Jacobian a face is needed.
        """
        if jacobians.shape != (self.mesh.faces.shape[0], 3, 3) or jacobians.dtype != torch.float64:
            raise ShapeError(
                f"expected jacobians ({self.mesh.faces.shape[0]}, 3, 3) float64, "
                f"got {tuple(jacobians.shape)} {jacobians.dtype}"
            )
        result: Tensor = _Solve.apply(self, jacobians)  # type: ignore[no-untyped-call]
        return result

    def _forward(self, jacobians: NDArray[np.float64]) -> NDArray[np.float64]:
        right = self._divergence @ jacobians.transpose(0, 2, 1).reshape(-1, 3)
        verts = self._apply_inverse(right)
        labels = self.components.numpy()
        return verts + (self._rest_centres - self._mean @ verts)[labels]

    def _backward(self, gradient: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.zeros((self.num_components, 3))
        np.add.at(sums, self.components.numpy(), gradient)
        right = self._apply_inverse(gradient - self._mean.T @ sums)
        return (self._divergence_t @ right).reshape(-1, 3, 3).transpose(0, 2, 1)

    def _apply_inverse(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.zeros_like(right)
        if self._factor is not None:
            out[self._free] = self._factor.solve(np.asfortranarray(right[self._free]))
        return out


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, system: PoissonSystem, jacobians: Tensor) -> Tensor:
        ctx.system = system  # type: ignore[attr-defined]
        return torch.from_numpy(system._forward(jacobians.detach().numpy()))

    @staticmethod
    @once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[None, Tensor]:
        system: PoissonSystem = ctx.system  # type: ignore[attr-defined]
        return None, torch.from_numpy(np.ascontiguousarray(system._backward(gradient.numpy())))


def _ungrounded(labels: NDArray[np.int64]) -> NDArray[np.int64]:
    """All vertices but the first of each component."""
    _, first = np.unique(labels, return_index=True)
    free = np.ones(len(labels), bool)
    free[first] = False
    return np.flatnonzero(free)


def _factorise(matrix: sparse.csr_matrix) -> tuple[SuperLU | None, float]:
    if matrix.shape[0] == 0:
        return None, 0.0
    scale = float(matrix.diagonal().mean())
    probe = np.linspace(1.0, 2.0, matrix.shape[0])
    for shift in _SHIFTS:
        shifted = (matrix + shift * scale * sparse.identity(matrix.shape[0])).tocsc()
        try:
            factor = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:
            continue
        back = factor.solve(shifted @ probe)
        if np.isfinite(back).all() and np.abs(back - probe).max() < 1e-3:
            return factor, shift
    raise NumericalError(
        "The mesh's Laplacian could not be factored.",
        advice="Remove needle-thin triangles (for example: merge vertices by distance), then try again.",
    )
