"""Revert a step where it breaks the surface, and keep the rest of it.

`step_limit` and `surface_guard` each pass a function that finds the broken faces. The repair tries the following in
order, until no face is broken:

1. Reset the Jacobians of the broken faces to their values before the step, and those around them in part:
   ``J <- J_old + a_f (J - J_old)`` with a_f = 0 on the broken faces, rising to 1 over the rings around them.
2. Reset the positions instead, over rings that double in number. Two limbs that run into each other are not stopped by
   their own Jacobians, because other faces move them.
3. Shorten the whole step of each component that is still broken, finally to zero.

Faces that become broken on the way are treated alike. The momentum of everything that was reset is cleared; otherwise
the optimiser would repeat the step at once. Plain backtracking would shorten the whole step, so that a single fold
would hold back the entire mesh.

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
    """Sets the variables of one run between two of their states, to undo a part of a step.

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
        """Return a copy of the current variables."""
        return {name: tensor.detach().clone() for name, tensor in self._variables.tensors.items()}

    @torch.no_grad()
    def repair(self, find_broken: Callable[[], _Flags], old: Mapping[str, Tensor], optimizer: Adam) -> _Flags:
        """Revert as much of the step as needed until no face is broken.

        Parameters
        ----------
        find_broken : callable
            Returns which faces (F,) of the current shape are broken. None is broken in `old`, or stays broken.
        old : mapping of name to Tensor
            The variables before the step, from `copy`.
        optimizer : Adam
            Loses the momentum of what is reset.

        Returns
        -------
        Flags (F,) of the faces that were held back: none if the step breaks nothing, all of a component if its step was
        shortened.
        """
        broken = find_broken()
        held = np.zeros(len(self._faces), bool)
        if not broken.any():
            return held
        new = self.copy()
        for rings in _BLEND_RINGS:
            held |= broken
            self._blend(old, new, self._ramp(held, rings))
            broken = find_broken()
            if not broken.any():
                self._reset_momentum(optimizer, held, np.zeros_like(held))
                return held
        if not self._hold_positions(find_broken, old, new, held, broken):
            self._set(new)
            held |= self._shorten(find_broken, old, new)
        # Positions were reset, which includes the translations of their components.
        self._reset_momentum(optimizer, held, held)
        return held

    def _ramp(self, held: _Flags, rings: int) -> _Floats:
        """Return shares (F,): 0 on the held faces, rising by 1 / (rings + 1) with every ring of faces around them."""
        share = np.ones(len(held))
        reached = held.astype(np.float64)
        share[held] = 0.0
        for ring in range(rings):
            reached = ((self._rest.face_adjacency @ reached) > 0).astype(np.float64)
            share = np.where(reached > 0, np.minimum(share, (ring + 1) / (rings + 1)), share)
        return share

    def _blend(self, old: Mapping[str, Tensor], new: Mapping[str, Tensor], share: _Floats) -> None:
        """Interpolate the variables between `old` (0) and `new` (1) by a share (F,) per face.

        Translations of components take their new values.
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
        find_broken: Callable[[], _Flags],
        old: Mapping[str, Tensor],
        new: Mapping[str, Tensor],
        held: _Flags,
        broken: _Flags,
    ) -> bool:
        """Reset positions on and around held faces, extending `held`; return whether no face is broken any more."""
        self._set(old)
        before = self._variables.place().detach()
        self._set(new)
        step = self._variables.place().detach() - before
        for rings in _HOLD_RINGS:
            held |= broken
            of_face = self._ramp(held, rings)
            # A vertex moves by the smallest share among its faces.
            of_vertex = np.ones(len(before))
            np.minimum.at(of_vertex, self._faces.ravel(), np.repeat(of_face, 3))
            self._set(new)
            self._variables.adopt(before + torch.from_numpy(of_vertex)[:, None] * step)
            broken = find_broken()
            if not broken.any():
                return True
        return False

    def _shorten(
        self, find_broken: Callable[[], _Flags], old: Mapping[str, Tensor], new: Mapping[str, Tensor]
    ) -> _Flags:
        """Shorten the steps of broken components until no face is broken; return flags (F,) of their faces.

        Another component can run into one that no longer moves, so the broken faces are found anew each time.
        """
        tried = np.zeros(self._rest.num_components, np.int64)
        for _ in range(_SHORTENINGS):
            broken = np.unique(self._component[find_broken()])
            if not len(broken):
                break
            tried[broken] = np.minimum(tried[broken] + 1, len(_SHARES))
            self._shorten_to(old, new, tried)
        else:
            tried[:] = len(_SHARES)
            self._shorten_to(old, new, tried)
        return np.asarray(tried[self._component] > 0)

    def _shorten_to(self, old: Mapping[str, Tensor], new: Mapping[str, Tensor], tried: _Index) -> None:
        """Set every component in `tried` to its share of the step; the others do not change."""
        share = np.array([1.0, *_SHARES])[tried]
        rows = self._variables.rows(
            of_face=self._component, of_vertex=self._component_of_vertex, of_component=np.arange(len(tried))
        )
        for name, tensor in self._variables.tensors.items():
            shorter = old[name] + _column(share[rows[name]], tensor) * (new[name] - old[name])
            tensor.copy_(torch.where(_column(tried[rows[name]] > 0, tensor), shorter, tensor))

    def _reset_momentum(self, optimizer: Adam, held: _Flags, carried: _Flags) -> None:
        """Clear the momentum of held faces (F,), and of the translations of components with `carried` faces (F,)."""
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
    """Reshape one value per row of `tensor` to broadcast against it."""
    return torch.from_numpy(np.ascontiguousarray(values)).view(-1, *[1] * (tensor.ndim - 1))
