"""Prevent steps from moving a face through zero area, so that the symmetric Dirichlet energy acts as a barrier.

The energy (`regularizers.py`) is infinite where a face collapses, but finite again where the face is flipped in its own
plane, so the optimiser must not cross the barrier. After every step, with a_f the area vectors::

    a_f(new) . a_f(old) >= 0.1 |a_f(old)|^2

must hold; where it does not, the step is reverted (`step_repair.py`). A face that rotates by a right angle or more
within one step is reverted too, but no step is that long.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.optimizer import Adam
from meshdeform.deformation.step_repair import StepRepair
from meshdeform.deformation.variables import Variables
from meshdeform.geometry.mesh import TriangleMesh, face_cross
from meshdeform.geometry.rest_mesh import RestMesh

__all__ = ["StepLimit"]

_LEAST = 0.1


class StepLimit:
    """Checks every step of a run, and reverts it where a face crosses zero area.

    Parameters
    ----------
    mesh : TriangleMesh
        The rest mesh; faces that are collapsed at rest are not checked, just as the energy leaves them out.
    variables : Variables
    """

    def __init__(self, mesh: TriangleMesh, variables: Variables) -> None:
        rest = RestMesh.of(mesh)
        self._variables, self._faces = variables, rest.faces
        self._solid = torch.from_numpy(rest.solid)
        self._repair = StepRepair(rest, variables)
        self.copy = self._repair.copy

    @torch.no_grad()
    def enforce(self, optimizer: Adam, old: Mapping[str, Tensor], verts: Tensor) -> int:
        """Revert the step where faces went through zero area since an earlier shape.

        Parameters
        ----------
        optimizer : Adam
        old : mapping of name to Tensor
            Variables of the earlier shape, from `copy`.
        verts : (V, 3) float64
            Vertices of the earlier shape.

        Returns
        -------
        Number of faces that were held back.
        """
        before = face_cross(verts.detach(), self._faces)
        return int(self._repair.repair(lambda: self._crossed(before), old, optimizer).sum())

    def _crossed(self, before: Tensor) -> NDArray[np.bool_]:
        after = face_cross(self._variables.place().detach(), self._faces)
        crossed = (after * before).sum(1) < _LEAST * before.square().sum(1)
        return (crossed & self._solid).numpy()
