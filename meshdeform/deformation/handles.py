"""Pull points of a surface to their goals, under an optimiser.

They act within the solve, on the control points u that the Jacobians give. With C the rows that take the points of the
handles from u, through the lattice, what is kept and the mirror, and G = S M S the response of a thin plate, S that of
the Poisson system::

    u <- u + G C^T (C G C^T + D)^-1 (goal - C u)

This is the smoothest correction that reaches the goals: C u = goal for D = 0. It reuses the factored matrix, is linear
in u, and so has an exact gradient. A soft handle of weight w has the entry (C G C^T)_hh (1 - w) / w in the diagonal
matrix D: if it is the only one, it goes the share w of its way.

Source: Botsch and Kobbelt 2004, An Intuitive Framework for Real-Time Freeform Modeling (thin plates with handles).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.deformation.constraints import HandleConstraint, VertexPlacement, handle_rows
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.tensors import sparse_product

_Floats = NDArray[np.float64]

_UNMOVED = 1e-12
_REACHED = 1e-6
_SINGULAR = 1e-9


class Handles:
    """The handles of one mesh and its variables.

    Parameters
    ----------
    placement : VertexPlacement, optional
        Places the vertices after the solve.
    embedding : sparse (V, N), optional
        Weights with which the vertices follow the control points; None if they are the same.
    smooth : callable
        G: returns displacements (N, 3) for forces (N, 3).

    Raises
    ------
    ParameterError
        A handle cannot reach its goal, because the point is kept or on the mirror plane, or two handles hold one
        point.
    """

    def __init__(
        self,
        handles: Sequence[HandleConstraint],
        mesh: RestMesh,
        placement: VertexPlacement | None,
        embedding: sparse.csr_matrix | None,
        smooth: Callable[[_Floats], _Floats],
    ) -> None:
        rows = handle_rows(handles, len(mesh.verts))
        rest = mesh.verts
        goals = np.stack([handle.goal for handle in handles])
        weights = np.array([handle.weight for handle in handles])
        placed = [rows if placement is None else (rows @ placement.matrix(axis)).tocsr() for axis in range(3)]
        offset = np.stack([(rows @ rest - placed[axis] @ rest)[:, axis] for axis in range(3)], 1)
        self._rows = [each if embedding is None else (each @ embedding).tocsr() for each in placed]
        self._goals = torch.from_numpy(goals - offset)
        forces = np.stack([each.toarray() for each in self._rows], 2)  # (H, N, 3)
        moved = np.stack([smooth(np.ascontiguousarray(force)) for force in forces])
        missing = goals - rows @ rest
        size = float(np.linalg.norm(np.ptp(rest, axis=0)))
        responses = [self._response(axis, moved[:, :, axis], weights, missing[:, axis], size) for axis in range(3)]
        self._responses = torch.from_numpy(np.stack(responses, 2))

    def _response(self, axis: int, moved: _Floats, weights: _Floats, missing: _Floats, size: float) -> _Floats:
        """Return the displacements (N, H) along one axis that move the handles by one unit each."""
        gram = np.asarray(self._rows[axis] @ moved.T)
        own = np.diag(gram).copy()
        stuck = own <= _UNMOVED * max(float(own.max()), 1e-300)
        for number in np.flatnonzero(stuck & (np.abs(missing) > _REACHED * size)):
            raise _refusal(
                int(number),
                f"handle {number} cannot move along {'xyz'[axis]}: its point is kept, or on the mirror plane.",
                "Move the handle, or keep less.",
            )
        free = ~stuck
        gram, own, weights = gram[free][:, free], own[free], weights[free]
        scaled = gram / np.sqrt(own[:, None] * own)
        if len(own) and np.linalg.eigvalsh(scaled).min() < _SINGULAR:
            close = np.abs(np.triu(scaled, 1))
            first, second = np.flatnonzero(free)[list(np.unravel_index(int(close.argmax()), close.shape))]
            detail = f"handles {first} and {second} hold one point, or its mirror image."
            raise _refusal(int(second), detail, "Leave one of them out.")
        gram[np.diag_indices_from(gram)] += own * (1 - weights) / weights
        out = np.zeros((moved.shape[1], len(moved)))
        out[:, free] = np.linalg.solve(gram, moved[free]).T
        return out

    def pull(self, control_points: Tensor) -> Tensor:
        """Return control points (N, 3) float64 that take the handles to their goals; differentiable."""
        reached = torch.cat([sparse_product(self._rows[k], control_points[:, k : k + 1]) for k in range(3)], 1)
        return control_points + (self._responses * (self._goals - reached)).sum(1)


def _refusal(number: int, detail: str, advice: str) -> ParameterError:
    path: list[str | int] = ["params", "control", "handles", number]
    return ParameterError.at(path, f"params.control.handles: {detail}", advice, message=detail)
