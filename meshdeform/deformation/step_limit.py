"""Prevent steps from moving an element through zero size, so that the symmetric Dirichlet energy acts as a barrier.

The energy is infinite where a face or a tetrahedron collapses, but finite again where it is flipped, so the optimiser
must not cross the barrier. After every step, with a the area vectors of the faces or the volumes of the tetrahedra::

    a(new) . a(old) >= 0.1 |a(old)|^2

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

__all__ = ["StepLimit"]

_LEAST = 0.1


class StepLimit:
    """Checks every step of a run, and reverts it where an element crosses zero size.

    Parameters
    ----------
    variables : Variables
        Those of the rest shape. Elements that are collapsed at rest are not checked.
    """

    def __init__(self, variables: Variables) -> None:
        self._variables = variables
        self._repair = StepRepair(variables)
        self.copy = self._repair.copy

    @torch.no_grad()
    def enforce(self, optimizer: Adam, old: Mapping[str, Tensor], control: Tensor) -> float:
        """Revert the step where elements went through zero size since an earlier shape.

        Parameters
        ----------
        optimizer : Adam
        old : mapping of name to Tensor
            Variables of the earlier shape, from `copy`.
        control : (N, 3) float64
            Control points of the earlier shape.

        Returns
        -------
        Share of the elements that were held back.
        """
        before = self._variables.sizes(control.detach())
        return float(self._repair.repair(lambda: self._crossed(before), old, optimizer).mean())

    def _crossed(self, before: Tensor) -> NDArray[np.bool_]:
        after = self._variables.sizes(self._variables.solve().detach())
        return ((after * before).sum(2) < _LEAST * before.square().sum(2)).any(1).numpy()
