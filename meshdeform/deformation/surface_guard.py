"""Keep the surface intact: revert steps that fold a face or make the surface intersect itself.

The shape is checked every few steps. Faces that were fine at rest and are now folded over their neighbours, or cut
through others, are reset to the last intact shape, and their neighbourhood in part (`StepRepair`). So every checked
shape of a run is intact, including the last one.

Faults that the asset already has at rest are allowed, and a crease may bend by a right angle before it is a fold.
Components that cut or touch each other at rest (a head in a collar, a vase on a table) may do so anywhere, and so may
the faces around places where a component cuts or touches itself (a lining in a shell). A rigid body does not give way,
so it may also cut the components within half a cell of it (a wheel and its arch). Faces without area at rest cannot
fold.

Where so many faces lie on or in each other that their pairs cannot be searched, the rest of the run is checked for
folds only.


`SurfaceGuard` passes to `StepRepair` a function that finds the elements with broken faces: faces of the surface, or
cells of a lattice. The repair tries the following in order, until nothing is broken:

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
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.deformation.settings import Safeguard
from meshdeform.deformation.variables import Adam, Elements, Variables, placed
from meshdeform.geometry.folds import FaceNeighbours
from meshdeform.geometry.intersections import TooManyPairsError, cutting_pairs, touching_pairs
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.surface_samples import count_samples, samples_of

_BLEND_RINGS = (2, 3)
_HOLD_RINGS = (1, 2, 3, 4, 6, 8, 12, 16, 32)

_FLATNESS = 1e-6
"""Added to the inertia of a region's points, relative to its trace."""

_SHARES = (0.5, 0.25, 0.1, 0.0)
_SHORTENINGS = 16
_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

EVERY_STEPS = 5
"""Steps between two checks. A check costs a quarter of a step to a whole one, and folds take a few steps to grow."""

_LOOSE_RINGS = 2

_CONTACT, _CONTACT_OF_EDGE = 1e-4, 0.1
"""Faces touch up to this share of the diagonal, and of their longest edge: in dense scans every face is near others."""

_SAMPLES = 20_000_000
"""Points, and pairs of near ones, by which the surroundings of rigid bodies are found."""


class StepRepair:
    """Sets the variables of one run between two of their states, to undo a part of a step."""

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
        """Return the number of regions of these elements, and the region of each."""
        # Cells that are close to each other are connected. Faces that cut each other may be far apart on the surface,
        # so there all belong together.
        if self._elements.holding is None:
            return 1, np.zeros(len(inside), np.int64)
        return self._elements.regions(inside)

    def _shorten(
        self, find_broken: Callable[[], _Flags], old: Mapping[str, Tensor], new: Mapping[str, Tensor]
    ) -> _Flags:
        """Shorten the steps of broken components until nothing is broken; return flags (E,) of their elements."""
        # Another component can run into one that no longer moves, so the broken elements are found anew each time.
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
    """Return points (P, 3) moved by the affine map that best takes `before` to `after`, weighted by (P, 1)."""
    # Where the points do not determine the map, because they lie in a plane, it does nothing across it.
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


class SurfaceGuard:
    """Checks the shape of a run, and reverts it to the last intact one where it is broken.

    Parameters
    ----------
    kind : Safeguard
        `flips` checks for folds only.
    mesh : TriangleMesh
        The rest mesh; its folds and intersections are allowed throughout.
    variables : Variables
        Those of the rest shape.

    Attributes
    ----------
    crowded : bool
        Whether a shape had too many pairs of faces that meet; since then only folds are found.
    """

    def __init__(self, kind: Safeguard, mesh: TriangleMesh, variables: Variables) -> None:
        self._kind, self._variables, self._surface = kind, variables, RestMesh.of(mesh)
        self._faces = self._surface.faces
        self.crowded = False
        count = len(self._faces)
        self._repair = StepRepair(variables)
        self._copy = self._repair.copy
        self._solid = np.flatnonzero(self._surface.solid)
        self._neighbours = FaceNeighbours(self._faces[self._solid], self._surface.verts)
        self._component = self._surface.components[self._faces[:, 0]]
        self._folded = np.zeros(count, bool)
        self._loose = np.zeros(count, bool)
        self._meeting: _Index = np.empty(0, np.int64)
        self._allow_faults(self._surface.verts)
        self._meeting = np.union1d(self._meeting, self._near_bodies())
        self._intact = self._copy()

    @property
    def warnings(self) -> list[str]:
        """A sentence for the user if only folds were found."""
        if not self.crowded:
            return []
        return [
            "Too many faces lie on or in each other to search for those that cut, so the safeguard only prevented "
            "folds. Remove copies that are in one place."
        ]

    @property
    def state(self) -> dict[str, Tensor]:
        """The last intact shape and the allowed faults, for checkpoints."""
        intact = {f"guard.{name}": tensor for name, tensor in self._intact.items()}
        allowed = {"folded": self._folded, "loose": self._loose, "meeting": self._meeting}
        if self.crowded:
            allowed["crowded"] = np.ones(1, bool)
        return {**intact, **{f"guard.{name}": torch.from_numpy(array) for name, array in allowed.items()}}

    def begin(self) -> None:
        """Take the current shape as intact, and allow all its faults."""
        self._allow_faults(placed(self._variables).detach().numpy())
        self._intact = self._copy()

    def restore(self, state: dict[str, Tensor]) -> None:
        """Continue from `state`, or from the current shape if the checkpoint is of a run without a guard."""
        if "guard.meeting" not in state:
            self.begin()
            return
        self._folded, self._loose, self._meeting = (
            state[f"guard.{name}"].numpy().copy() for name in ("folded", "loose", "meeting")
        )
        self.crowded = "guard.crowded" in state
        self._intact = {name: state[f"guard.{name}"].clone() for name in self._variables.tensors}

    @property
    def _searches(self) -> bool:
        return self._kind is Safeguard.INTERSECTIONS and not self.crowded

    def _allow_faults(self, verts: _Floats) -> None:
        """Allow the faults of this shape in addition to those already allowed."""
        self._folded |= self._folds(verts)
        if not self._searches:
            return
        try:
            contacts = touching_pairs(verts, self._faces, self._reach(verts))
        except TooManyPairsError:
            self.crowded = True
            return
        own = contacts[self._component[contacts[:, 0]] == self._component[contacts[:, 1]]]
        own = own[~self._across_collapsed(own)]
        reached, surface = np.zeros(len(self._faces), bool), Elements.faces_of(self._surface)
        reached[own.ravel()] = True
        for _ in range(_LOOSE_RINGS):
            reached = surface.spread(reached)
        self._loose |= reached
        self._meeting = np.union1d(self._meeting, self._keys(contacts))

    def _near_bodies(self) -> _Index:
        """Return the keys of the pairs of components of which one has a rigid body within half a cell of the other."""
        rigid = self._variables.elements.rigid
        if rigid is None or not self._searches:
            return np.empty(0, np.int64)
        reach = self._variables.resolution / 2
        if count_samples(self._surface.verts, self._faces, reach / 2) > _SAMPLES:
            self.crowded = True
            return np.empty(0, np.int64)
        points, face = samples_of(self._surface.verts, self._faces, reach / 2)
        # One point per component and voxel is enough, and a dense scan has many.
        voxel = np.column_stack([np.floor(points / (reach / 4)), self._component[face], rigid[face]]).astype(np.int64)
        kept = np.unique(voxel, axis=0, return_index=True)[1]
        points, face = points[kept], face[kept]
        tree, of_bodies = cKDTree(points), points[rigid[face]]
        if tree.query_ball_point(of_bodies, reach, return_length=True).sum() > _SAMPLES:
            self.crowded = True
            return np.empty(0, np.int64)
        near = tree.query_ball_point(of_bodies, reach, return_sorted=False)
        owner = np.repeat(face[rigid[face]], [len(neighbours) for neighbours in near])
        return self._keys(np.column_stack([owner, face[np.concatenate(near).astype(np.int64)]]))

    def _across_collapsed(self, pairs: _Index) -> _Flags:
        """Return flags (P,) of the pairs of faces with a collapsed face between them, which are neighbours."""
        collapsed = np.flatnonzero(~self._surface.solid)
        if not len(collapsed) or not len(pairs):
            return np.zeros(len(pairs), bool)
        beside = (self._surface.incidence[collapsed] @ self._surface.incidence.T >= 2).astype(np.float64)
        return np.asarray((beside.T @ beside)[pairs[:, 0], pairs[:, 1]] > 0).ravel()

    def _reach(self, verts: _Floats) -> _Floats:
        """Return the distance (F,) up to which each face touches others."""
        corners = verts[self._faces]
        longest = np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(2).max(1))
        diagonal = float(np.linalg.norm(np.ptp(verts[np.unique(self._faces)], axis=0)))
        return np.asarray(np.minimum(_CONTACT * diagonal, _CONTACT_OF_EDGE * longest))

    def _keys(self, pairs: _Index) -> _Index:
        """Return a unique key for each pair of different components among these pairs of faces (P, 2)."""
        components = np.sort(self._component[pairs], axis=1)
        apart = components[components[:, 0] != components[:, 1]]
        return np.unique(apart[:, 0] * self._surface.num_components + apart[:, 1])

    @torch.no_grad()
    def correct(self, optimizer: Adam) -> float:
        """Revert the shape where it is broken.

        Returns
        -------
        Share of the elements that were reset: 0 if the shape was intact, all of a component if nothing else helped.
        """
        elements = self._variables.elements
        held = self._repair.repair(lambda: elements.of_faces(self._find_broken()), self._intact, optimizer)
        self._intact = self._copy()
        return float(held.mean())

    def _find_broken(self) -> _Flags:
        """Return flags (F,) of the faces that are broken and not allowed to be."""
        verts = placed(self._variables).detach().numpy()
        broken = self._folds(verts) & ~self._folded
        if self._searches:
            try:
                cuts = cutting_pairs(verts, self._faces)
            except TooManyPairsError:
                self.crowded = True
                return broken
            first, second = self._component[cuts].T
            low, high = np.minimum(first, second), np.maximum(first, second)
            key = low * self._surface.num_components + high
            allowed = np.where(low == high, self._loose[cuts].all(1), np.isin(key, self._meeting))
            broken[cuts[~allowed].ravel()] = True
        return broken

    def _folds(self, verts: _Floats) -> _Flags:
        folded = np.zeros(len(self._faces), bool)
        folded[self._solid] = self._neighbours.folded(verts)
        return folded
