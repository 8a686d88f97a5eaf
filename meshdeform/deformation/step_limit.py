"""No step carries a face through zero area: what makes the symmetric Dirichlet energy a barrier (`regularizers.py`).

The energy is infinite where a face collapses and finite again beyond, where it lies turned over in its own plane. So
the optimiser must not jump across. After every step, with a_f the area vectors::

    a_f(new) . a_f(old) >= 0.1 |a_f(old)|^2

where that does not hold, the face goes back to where it was, and its surroundings in part, with rings that grow; where
that does not help, the whole step is shortened, at last to nothing. What was put back loses its momentum. A face that
turns by a right angle within one step is held as well: no step is that long.

Source: Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, section 3.3, whose line search
shortens the whole step; here it is the last resort, for one face would hold back all others.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.face_blend import FaceBlend
from meshdeform.deformation.optimizer import Adam
from meshdeform.deformation.variables import Variables
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.operators import effective_face_areas

__all__ = ["StepLimit"]

_LEAST = 0.1
_RINGS = (1, 2, 4, 8)
_SHARES = (0.5, 0.25, 0.125, 0.0625, 0.0)


class StepLimit:
    """Looks at every step of a run.

    Parameters
    ----------
    mesh : TriangleMesh
        At rest; faces without area there are no concern of the energy, nor of this.
    variables : Variables
    """

    def __init__(self, mesh: TriangleMesh, variables: Variables) -> None:
        self._variables, self._faces = variables, mesh.faces
        self._solid = torch.from_numpy(effective_face_areas(mesh) > 0)
        self._partly = FaceBlend(mesh, variables)
        self.copy = self._partly.copy

    @torch.no_grad()
    def keep(self, optimizer: Adam, old: Mapping[str, Tensor], verts: Tensor) -> int:
        """Take back what went through zero area since a shape.

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
        before = self._area_vectors(verts.detach())
        crossed = self._crossed(before)
        if not crossed.any():
            return 0
        new, held = self._partly.copy(), crossed
        for rings in _RINGS:
            self._partly.between(old, new, self._partly.ramp(held, rings))
            crossed = self._crossed(before)
            if not crossed.any():
                break
            held = held | crossed
        else:
            held = np.ones_like(held)
            self._shorten(old, new, before)
        self._forget(optimizer, held)
        return int(held.sum())

    def _area_vectors(self, verts: Tensor) -> Tensor:
        corners = verts[self._faces]
        vectors: Tensor = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return vectors

    def _crossed(self, before: Tensor) -> NDArray[np.bool_]:
        after = self._area_vectors(self._variables.place().detach())
        crossed = (after * before).sum(1) < _LEAST * before.square().sum(1)
        return (crossed & self._solid).numpy()

    def _shorten(self, old: Mapping[str, Tensor], new: Mapping[str, Tensor], before: Tensor) -> None:
        for share in _SHARES:
            for name, tensor in self._variables.tensors.items():
                tensor.copy_(old[name] + share * (new[name] - old[name]) if share else old[name])
            if not self._crossed(before).any():
                return

    def _forget(self, optimizer: Adam, held: NDArray[np.bool_]) -> None:
        of_vertex = self._partly.incidence.T @ held.astype(np.float64) > 0
        for name, rows in (("jacobians", held), ("displacements", of_vertex)):
            tensor = self._variables.tensors.get(name)
            momentum = optimizer.state.get(tensor, {}).get("exp_avg") if tensor is not None else None
            if momentum is not None:
                momentum[torch.from_numpy(rows)] = 0.0
