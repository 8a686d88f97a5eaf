"""Keep every step from carrying a face through zero area: what makes the symmetric Dirichlet energy a barrier.

The energy (`regularizers.py`) is infinite where a face collapses and finite again beyond, where it lies turned over in
its own plane. So the optimiser must not jump across. After every step, with a_f the area vectors::

    a_f(new) . a_f(old) >= 0.1 |a_f(old)|^2

where that does not hold, the step is taken back (`step_repair.py`). A face that turns by a right angle within one step
is held as well: no step is that long.
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
    """Checks every step of a run.

    Parameters
    ----------
    mesh : TriangleMesh
        At rest; faces that are collapsed there do not count, in the energy as here.
    variables : Variables
    """

    def __init__(self, mesh: TriangleMesh, variables: Variables) -> None:
        rest = RestMesh.of(mesh)
        self._variables, self._faces = variables, rest.faces
        self._solid = torch.from_numpy(rest.solid)
        self._repair = StepRepair(rest, variables)
        self.copy = self._repair.copy

    @torch.no_grad()
    def keep(self, optimizer: Adam, old: Mapping[str, Tensor], verts: Tensor) -> int:
        """Take back what went through zero area since an earlier shape.

        Parameters
        ----------
        optimizer : Adam
        old : mapping of name to Tensor
            The variables of that shape, from `copy`.
        verts : (V, 3) float64
            Its vertices.

        Returns
        -------
        How many faces were held.
        """
        before = face_cross(verts.detach(), self._faces)
        return int(self._repair.repair(lambda: self._crossed(before), old, optimizer).sum())

    def _crossed(self, before: Tensor) -> NDArray[np.bool_]:
        after = face_cross(self._variables.place().detach(), self._faces)
        crossed = (after * before).sum(1) < _LEAST * before.square().sum(1)
        return (crossed & self._solid).numpy()
