"""Revert a step where it breaks the surface, and keep the rest of it.

`surface_guard` passes a function that finds the elements with broken faces: faces of the surface, or cells of a
lattice. The repair tries the following in order, until nothing is broken:

1. Reset the Jacobians of the broken elements to their values before the step, and those around them in part:
   ``J <- J_old + a (J - J_old)`` with a = 0 on the broken elements, rising to 1 over the rings around them.
2. If every element has a Jacobian of its own, move the region around the broken ones as a whole: by the affine map that
   fits its step best, blended into the free step over rings that double in number. An affine map neither folds nor
   cuts what was intact. Two limbs that run into each other are not stopped by their own Jacobians, because other faces
   move them.
3. Shorten the whole step of each component that is still broken, finally to zero.

Elements that become broken on the way are treated alike. The momentum of everything that was reset is cleared;
otherwise the optimiser would repeat the step at once. Plain backtracking would shorten the whole step, so that a single
fold would hold back the entire mesh.

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

__all__ = ["StepRepair"]

_BLEND_RINGS = (2, 3)
_HOLD_RINGS = (1, 2, 3, 4, 6, 8, 12, 16, 32)
_FLATNESS = 1e-6
"""Added to the inertia of a region's points, relative to its trace."""
_SHARES = (0.5, 0.25, 0.1, 0.0)
_SHORTENINGS = 16

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class StepRepair:
    """Sets the variables of one run between two of their states, to undo a part of a step.

    Parameters
    ----------
    variables : Variables
    """

    def __init__(self, variables: Variables) -> None:
        self._variables, self._elements = variables, variables.elements
        self._component = self._elements.component

    def copy(self) -> dict[str, Tensor]:
        """Return a copy of the current variables."""
        return {name: tensor.detach().clone() for name, tensor in self._variables.tensors.items()}

    @torch.no_grad()
    def repair(
        self,
        find_broken: Callable[[], _Flags],
        old: Mapping[str, Tensor],
        optimizer: Adam,
    ) -> _Flags:
        """Revert as much of the step as needed until no element is broken.

        Parameters
        ----------
        find_broken : callable
            Returns which elements (E,) of the current shape are broken. None is broken in `old`, or stays broken.
        old : mapping of name to Tensor
            The variables before the step, from `copy`.
        optimizer : Adam
            Loses the momentum of what is reset.

        Returns
        -------
        Flags (E,) of the elements that were held back: none if the step breaks nothing, all of a component if its step
        was shortened.
        """
        broken = find_broken()
        held = np.zeros(len(self._elements), bool)
        if not broken.any():
            return held
        new = self.copy()
        for rings in _BLEND_RINGS:
            held |= broken
            self._blend(old, new, self._ramp(held, rings))
            broken = find_broken()
            if not broken.any():
                self._reset_momentum(optimizer, held)
                return held
        if not (self._variables.local and self._hold_regions(find_broken, old, new, held, broken)):
            self._set(new)
            held |= self._shorten(find_broken, old, new)
        self._reset_momentum(optimizer, held)
        return held

    def _ramp(self, held: _Flags, rings: int) -> _Floats:
        """Return shares (E,): 0 on the held elements, rising by 1 / (rings + 1) with every ring around them."""
        share = np.ones(len(held))
        reached = held
        share[held] = 0.0
        for ring in range(rings):
            reached = self._elements.spread(reached)
            share = np.where(reached, np.minimum(share, (ring + 1) / (rings + 1)), share)
        return share

    def _blend(self, old: Mapping[str, Tensor], new: Mapping[str, Tensor], share: _Floats) -> None:
        """Interpolate the variables between `old` (0) and `new` (1) by a share (E,) per element."""
        rows = self._variables.rows(share)
        for name, tensor in self._variables.tensors.items():
            tensor.copy_(old[name] + _column(rows[name], tensor) * (new[name] - old[name]))

    def _hold_regions(
        self,
        find_broken: Callable[[], _Flags],
        old: Mapping[str, Tensor],
        new: Mapping[str, Tensor],
        held: _Flags,
        broken: _Flags,
    ) -> bool:
        """Move regions around held elements affinely, extending `held`; return whether nothing is broken any more."""
        self._set(old)
        before = self._variables.solve().detach().numpy()
        self._set(new)
        after = self._variables.solve().detach().numpy()
        for rings in _HOLD_RINGS:
            held |= broken
            share = self._ramp(self._ramp(held, rings // 2) < 1, rings - rings // 2)
            # From the blended variables, because a lattice adopts differences from node to node only slowly.
            self._blend(old, new, share)
            self._variables.adopt(torch.from_numpy(self._moved_affinely(before, after, share)))
            broken = find_broken()
            if not broken.any():
                return True
        return False

    def _moved_affinely(self, before: _Floats, after: _Floats, share: _Floats) -> _Floats:
        """Replace the step by the best affine map of each region; `share` (E,) of an element's own step remains."""
        inside = np.flatnonzero(share < 1)
        corners = self._elements.corners
        count, region = self._regions(inside)
        label = np.full(len(before), -1)
        label[corners[inside].ravel()] = np.repeat(region, corners.shape[1])
        weight = 1 - self._elements.least_at_corners(share, len(before))
        moved = after.copy()
        for number in range(count):
            points = np.flatnonzero(label == number)
            w = weight[points][:, None]
            moved[points] += w * (_affine_fit(before[points], after[points], w) - after[points])
        return moved

    def _regions(self, inside: _Index) -> tuple[int, _Index]:
        """Return the number of regions of these elements, and the region of each.

        Cells that are close to each other are connected. Faces that cut each other may be far apart on the surface, so
        there all belong together.
        """
        if self._elements.holding is None:
            return 1, np.zeros(len(inside), np.int64)
        return self._elements.regions(inside)

    def _shorten(
        self, find_broken: Callable[[], _Flags], old: Mapping[str, Tensor], new: Mapping[str, Tensor]
    ) -> _Flags:
        """Shorten the steps of broken components until nothing is broken; return flags (E,) of their elements.

        Another component can run into one that no longer moves, so the broken elements are found anew each time.
        """
        tried = np.zeros(int(self._component.max()) + 1, np.int64)
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
        """Set every component in `tried` to its share of the step, and the others to the whole step."""
        self._blend(old, new, np.array([1.0, *_SHARES])[tried][self._component])

    def _reset_momentum(self, optimizer: Adam, held: _Flags) -> None:
        """Clear the momentum of held elements (E,)."""
        rows = self._variables.rows((~held).astype(np.float64))
        for name, tensor in self._variables.tensors.items():
            momentum = optimizer.state.get(tensor, {}).get("exp_avg")
            if momentum is not None:
                momentum[torch.from_numpy(rows[name] == 0)] = 0.0

    def _set(self, state: Mapping[str, Tensor]) -> None:
        for name, tensor in self._variables.tensors.items():
            tensor.copy_(state[name])


def _affine_fit(before: _Floats, after: _Floats, weight: _Floats) -> _Floats:
    """Return points (P, 3) moved by the affine map that best takes `before` to `after`, weighted by (P, 1).

    Where the points do not determine the map, because they lie in a plane, it does nothing across it.
    """
    total = max(float(weight.sum()), 1e-300)
    centre, goal = (weight * before).sum(0) / total, (weight * after).sum(0) / total
    arms = before - centre
    spread = (weight * arms).T @ arms
    linear = np.linalg.solve(
        spread + (_FLATNESS * np.trace(spread) + 1e-300) * np.eye(3), (weight * arms).T @ (after - goal - arms)
    )
    if np.linalg.det(np.eye(3) + linear) <= 0:
        linear = np.zeros((3, 3))
    return np.asarray(goal + arms + arms @ linear)


def _column(values: NDArray[np.generic], tensor: Tensor) -> Tensor:
    """Reshape one value per row of `tensor` to broadcast against it."""
    return torch.from_numpy(np.ascontiguousarray(values)).view(-1, *[1] * (tensor.ndim - 1))
