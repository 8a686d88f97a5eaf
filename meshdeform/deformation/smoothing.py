"""Coarse to fine on the mesh: early gradients are smoothed over the surface, by less and less.

A gradient g on the Jacobians becomes::

    g <- c B^T (M + l^2 L)^-1 B g        B averages faces onto their vertices, M are the vertices' areas

which is symmetric and positive definite, so it is still downhill, only by another notion of length: two Jacobians are
near when their difference is smooth at the length l. c keeps the length of g, which says nothing to Adam. l falls from
its first value by halves. M and L are block diagonal in the components and have no need of a closed, oriented or
manifold surface, so this is coarse to fine for every mesh that the Poisson solve takes, without a hierarchy.

Adam divides each entry by its own history all the same and so makes the steps of all faces alike in length; smooth are
their directions. Where lengths shall stay smooth too, `adam_uniform` divides all entries by one number; with smoothing
that is the method of Nicolet et al., on Jacobians.

Source: Nicolet et al. 2021, Large Steps in Inverse Rendering of Geometry, eq. 14; Desbrun et al. 1999, Implicit
Fairing.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from meshdeform.deformation.ldl import Factor, factorise
from meshdeform.errors import NumericalError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.operators import cotangent_laplacian, vertex_areas

__all__ = ["STAGES", "GradientSmoothing"]

STAGES = 4
"""Lengths: the first one, its half, its quarter and its eighth."""
_AREA_FLOOR = 1e-3


class GradientSmoothing:
    """Smooths what is given for each face of one rest mesh.

    Parameters
    ----------
    mesh : TriangleMesh
    length : float
        The first length, as a share of the diagonal of the mesh's box.
    until : float in (0, 1]
        Share of the run after which nothing is smoothed.
    """

    def __init__(self, mesh: TriangleMesh, length: float, until: float) -> None:
        count, n_verts = mesh.faces.shape[0], mesh.verts.shape[0]
        self._until = until
        self._length = length * float(np.linalg.norm(np.ptp(mesh.verts.numpy(), axis=0))) if n_verts else 0.0
        columns = mesh.faces.numpy().ravel()
        third = np.full(3 * count, 1 / 3)
        self._to_verts = sparse.csr_matrix((third, (columns, np.arange(3 * count) // 3)), shape=(n_verts, count))
        areas = vertex_areas(mesh)
        used = areas > 0
        # A vertex of needles alone has nearly no area, and its row would be a Laplacian without a diagonal.
        floor = _AREA_FLOOR * float(areas[used].mean()) if used.any() else 1.0
        self._mass = sparse.diags(np.maximum(areas, floor))
        self._laplacian = cotangent_laplacian(mesh)
        self._factors: dict[int, Factor] = {}

    def stage(self, fraction: float) -> int | None:
        """Which length counts at this fraction of the run: 0 for the first one; None for no smoothing."""
        return int(STAGES * fraction / self._until) if fraction < self._until else None

    def apply(self, gradient: Tensor, fraction: float) -> Tensor:
        """Smooth the gradient (F, 3, 3) float64 as this fraction of the run has it.

        Raises
        ------
        NumericalError
            The mesh's Laplacian could not be factored.
        """
        stage = self.stage(fraction)
        if stage is None:
            return gradient
        rows = np.ascontiguousarray(gradient.numpy().reshape(len(gradient), 9))
        on_verts, factor = self._to_verts @ rows, self._factor(stage)
        solved = np.concatenate([factor.solve(np.ascontiguousarray(on_verts[:, k : k + 3])) for k in (0, 3, 6)], axis=1)
        smooth = torch.from_numpy(np.ascontiguousarray(self._to_verts.T @ solved)).view_as(gradient)
        length = float(smooth.norm())
        return smooth * (float(gradient.norm()) / length) if length > 0 else gradient

    def _factor(self, stage: int) -> Factor:
        if stage not in self._factors:
            length = self._length / 2**stage
            matrix = (self._mass + length**2 * self._laplacian).tocsr()
            factor = factorise(matrix, np.arange(matrix.shape[0]))
            if factor is None:
                raise NumericalError(
                    "The mesh's Laplacian could not be factored.", advice="Leave smoothing_start out, or set it to 0."
                )
            self._factors = {stage: factor}
        return self._factors[stage]
