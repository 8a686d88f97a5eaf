"""Take a step back where it breaks the surface, and keep the rest of it.

What counts as broken is asked of a function; `step_limit` and `surface_guard` have one each. The repair tries, until
nothing is broken, in this order:

1. The Jacobians of the broken faces go back to what they were before the step, and their surroundings in part, less the
   farther away: ``J <- J_old + a_f (J - J_old)``, a_f = 0 on the broken faces, rising to 1 over the rings around them.
2. The positions go back, with rings that double: two limbs that run into each other are stopped by no Jacobian of
   theirs, for what moves them lies elsewhere.
3. The whole step of each component that is still broken is shortened, at last to nothing.

What becomes broken on the way joins in. The optimiser's momentum of what was put back is forgotten, or it would push on
at once. Plain backtracking shortens the whole step at the first fold, and one fold would hold back all other parts.

Source of the backtracking: Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, section 3.3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.optimizer import Adam
from meshdeform.deformation.variables import Variables
from meshdeform.geometry.rest_mesh import RestMesh

__all__ = ["StepRepair"]

_BLEND_RINGS = (2, 3)
_HOLD_RINGS = (2, 4, 8, 16, 32)
_SHARES = (0.5, 0.25, 0.1, 0.0)
_SHORTENINGS = 16

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class StepRepair:
    """Sets the variables of one run between two of their states.

    Parameters
    ----------
    rest : RestMesh
    variables : Variables
    """

    def __init__(self, rest: RestMesh, variables: Variables) -> None:
        self._rest, self._variables = rest, variables
        self._faces = rest.faces.numpy()
        self._component_of_vertex = rest.components.numpy()
        self._component = self._component_of_vertex[self._faces[:, 0]]

    def copy(self) -> dict[str, Tensor]:
        """Return the variables as they stand."""
        return {name: tensor.detach().clone() for name, tensor in self._variables.tensors.items()}

    @torch.no_grad()
    def repair(self, look: Callable[[], _Flags], old: Mapping[str, Tensor], optimizer: Adam) -> _Flags:
        """Take back as much of the step as it takes for nothing to be broken.

        Parameters
        ----------
        look : callable
            Returns which faces (F,) are broken in the shape that the variables mean now. Nothing is broken in `old`, or
            what is stays so.
        old : mapping of name to Tensor
            The variables before the step, from `copy`.
        optimizer : Adam
            Loses the momentum of what is put back.

        Returns
        -------
        Which faces (F,) were held back: none where the step breaks nothing, those of whole components where their step
        was shortened.
        """
        broken = look()
        held = np.zeros(len(self._faces), bool)
        if not broken.any():
            return held
        wished = self.copy()
        for rings in _BLEND_RINGS:
            held |= broken
            self._blend(old, wished, self._ramp(held, rings))
            broken = look()
            if not broken.any():
                self._forget(optimizer, held, np.zeros_like(held))
                return held
        if not self._hold_positions(look, old, wished, held, broken):
            self._set(wished)
            held |= self._shorten(look, old, wished)
        # Positions were put back, and a component's translation is a part of them.
        self._forget(optimizer, held, held)
        return held

    def _ramp(self, held: _Flags, rings: int) -> _Floats:
        """Return shares (F,): 0 on the held faces, then 1 / (rings + 1) more with every ring of faces around them."""
        share = np.ones(len(held))
        reached = held.astype(np.float64)
        share[held] = 0.0
        for ring in range(rings):
            reached = ((self._rest.face_adjacency @ reached) > 0).astype(np.float64)
            share = np.where(reached > 0, np.minimum(share, (ring + 1) / (rings + 1)), share)
        return share

    def _blend(self, old: Mapping[str, Tensor], new: Mapping[str, Tensor], share: _Floats) -> None:
        """Set the variables between `old` (0) and `new` (1) by a share (F,) for each face.

        Components move as wholes.
        """
        rows = self._variables.rows(
            of_face=share,
            of_vertex=1.0 - (self._rest.incidence.T @ (1 - share) > 0),
            of_component=np.ones(self._rest.num_components),
        )
        for name, tensor in self._variables.tensors.items():
            tensor.copy_(old[name] + _column(rows[name], tensor) * (new[name] - old[name]))

    def _hold_positions(
        self,
        look: Callable[[], _Flags],
        old: Mapping[str, Tensor],
        new: Mapping[str, Tensor],
        held: _Flags,
        broken: _Flags,
    ) -> bool:
        """Put positions back where faces are held, and around them; return whether that was enough. `held` grows."""
        self._set(old)
        before = self._variables.place().detach()
        self._set(new)
        step = self._variables.place().detach() - before
        for rings in _HOLD_RINGS:
            held |= broken
            of_face = self._ramp(held, rings)
            # A vertex goes as far as the most held of its faces.
            of_vertex = np.ones(len(before))
            np.minimum.at(of_vertex, self._faces.ravel(), np.repeat(of_face, 3))
            self._set(new)
            self._variables.adopt(before + torch.from_numpy(of_vertex)[:, None] * step)
            broken = look()
            if not broken.any():
                return True
        return False

    def _shorten(self, look: Callable[[], _Flags], old: Mapping[str, Tensor], new: Mapping[str, Tensor]) -> _Flags:
        """Shorten the step of every component that is broken until none is; return the faces (F,) of those shortened.

        A component that stands still can be run into, so what is broken is looked for anew each time.
        """
        tried = np.zeros(self._rest.num_components, np.int64)
        for _ in range(_SHORTENINGS):
            broken = np.unique(self._component[look()])
            if not len(broken):
                break
            tried[broken] = np.minimum(tried[broken] + 1, len(_SHARES))
            self._shorten_to(old, new, tried)
        else:
            tried[:] = len(_SHARES)
            self._shorten_to(old, new, tried)
        return np.asarray(tried[self._component] > 0)

    def _shorten_to(self, old: Mapping[str, Tensor], new: Mapping[str, Tensor], tried: _Index) -> None:
        """Set every component that was tried to its share of the step; the others keep what they have."""
        share = np.array([1.0, *_SHARES])[tried]
        rows = self._variables.rows(
            of_face=self._component, of_vertex=self._component_of_vertex, of_component=np.arange(len(tried))
        )
        for name, tensor in self._variables.tensors.items():
            shorter = old[name] + _column(share[rows[name]], tensor) * (new[name] - old[name])
            tensor.copy_(torch.where(_column(tried[rows[name]] > 0, tensor), shorter, tensor))

    def _forget(self, optimizer: Adam, held: _Flags, carried: _Flags) -> None:
        """Drop the momentum of the held faces (F,), and of the translations of components with carried ones (F,)."""
        rows = self._variables.rows(
            of_face=held,
            of_vertex=self._rest.incidence.T @ held.astype(np.float64) > 0,
            of_component=np.bincount(self._component[carried], minlength=self._rest.num_components) > 0,
        )
        for name, tensor in self._variables.tensors.items():
            momentum = optimizer.state.get(tensor, {}).get("exp_avg")
            if momentum is not None:
                momentum[torch.from_numpy(rows[name])] = 0.0

    def _set(self, state: Mapping[str, Tensor]) -> None:
        for name, tensor in self._variables.tensors.items():
            tensor.copy_(state[name])


def _column(values: NDArray[np.generic], tensor: Tensor) -> Tensor:
    """Return one value for each row of `tensor`, shaped to be multiplied with it."""
    return torch.from_numpy(np.ascontiguousarray(values)).view(-1, *[1] * (tensor.ndim - 1))
