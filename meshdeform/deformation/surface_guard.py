"""Keep the surface intact: revert steps that fold a face or make the surface intersect itself.

The shape is checked every few steps. Faces that were fine at rest and are now folded over their neighbours, or cut
through others, are reset to the last intact shape, and their neighbourhood in part (`step_repair.py`). So every checked
shape of a run is intact, including the last one.

Faults that the asset already has at rest are allowed, and a crease may bend by a right angle before it is a fold.
Components that cut or touch each other at rest (a head in a collar, a vase on a table) may do so anywhere, and so may
the faces around places where a component cuts or touches itself (a lining in a shell). A rigid body does not give way,
so it may also cut the components within half a cell of it (a wheel and its arch). Faces without area at rest cannot
fold.

Where so many faces lie on or in each other that their pairs cannot be searched, the rest of the run is checked for
folds only.

A skin is checked in the pose that viewers show: how its bind pose looks, nobody sees.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.deformation.optimizer import Adam
from meshdeform.deformation.settings import Safeguard
from meshdeform.deformation.step_repair import StepRepair
from meshdeform.deformation.variables import Elements, Variables, placed
from meshdeform.geometry.intersections import TooManyPairsError, cutting_pairs, touching_pairs
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import FaceNeighbours
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.samples import count_samples, samples_of

__all__ = ["EVERY_STEPS", "SurfaceGuard"]

EVERY_STEPS = 5
"""Steps between two checks. A check costs a quarter of a step to a whole one, and folds take a few steps to grow."""

_LOOSE_RINGS = 2
_CONTACT, _CONTACT_OF_EDGE = 1e-4, 0.1
"""Faces touch up to this share of the diagonal, and of their longest edge: in dense scans every face is near others."""
_SAMPLES = 20_000_000
"""Points, and pairs of near ones, by which the surroundings of rigid bodies are found."""

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


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
    pose : (V, 3, 4) float64, optional
        The affine map of each vertex to where viewers show it, if that is not where it is stored.

    Attributes
    ----------
    crowded : bool
        Whether a shape had too many pairs of faces that meet; since then only folds are found.
    """

    def __init__(self, kind: Safeguard, mesh: TriangleMesh, variables: Variables, pose: _Floats | None = None) -> None:
        self._kind, self._variables, self._pose, self._surface = kind, variables, pose, RestMesh.of(mesh)
        self._rest = self._surface
        if pose is not None:
            posed = torch.from_numpy(self._shown(self._surface.verts.numpy()))
            self._rest = RestMesh.of(TriangleMesh(posed, self._surface.faces))
        self._faces = self._surface.faces.numpy()
        self.crowded = False
        count = len(self._faces)
        self._repair = StepRepair(variables)
        self._copy = self._repair.copy
        self._solid = np.flatnonzero(self._rest.solid)
        self._neighbours = FaceNeighbours(self._faces[self._solid], self._rest.verts.numpy())
        self._component = self._surface.components.numpy()[self._faces[:, 0]]
        self._folded = np.zeros(count, bool)
        self._loose = np.zeros(count, bool)
        self._meeting: _Index = np.empty(0, np.int64)
        self._allow_faults(self._rest.verts.numpy())
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
        self._allow_faults(self._shown(placed(self._variables).detach().numpy()))
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
        if count_samples(self._surface.verts.numpy(), self._faces, reach / 2) > _SAMPLES:
            self.crowded = True
            return np.empty(0, np.int64)
        points, face = samples_of(self._surface.verts.numpy(), self._faces, reach / 2)
        # One point per component and voxel is enough, and a dense scan has many.
        voxel = np.column_stack([np.floor(points / (reach / 4)), self._component[face], rigid[face]]).astype(np.int64)
        kept = np.unique(voxel, axis=0, return_index=True)[1]
        points, face = points[kept], face[kept]
        tree, of_bodies = cKDTree(points), points[rigid[face]]
        if tree.query_ball_point(of_bodies, reach, return_length=True).sum() > _SAMPLES:
            self.crowded = True
            return np.empty(0, np.int64)
        near = tree.query_ball_point(of_bodies, reach, return_sorted=False)
        owner = np.repeat(face[rigid[face]], [len(found) for found in near])
        return self._keys(np.column_stack([owner, face[np.concatenate(near).astype(np.int64)]]))

    def _across_collapsed(self, pairs: _Index) -> _Flags:
        """Return flags (P,) of the pairs of faces with a collapsed face between them, which are neighbours."""
        collapsed = np.flatnonzero(~self._rest.solid)
        if not len(collapsed) or not len(pairs):
            return np.zeros(len(pairs), bool)
        beside = (self._rest.incidence[collapsed] @ self._rest.incidence.T >= 2).astype(np.float64)
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
        verts = self._shown(placed(self._variables).detach().numpy())
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

    def _shown(self, verts: _Floats) -> _Floats:
        """Return where viewers show the vertices (V, 3) of the surface."""
        if self._pose is None:
            return verts
        return np.asarray(np.einsum("nij,nj->ni", self._pose[:, :, :3], verts) + self._pose[:, :, 3])

    def _folds(self, verts: _Floats) -> _Flags:
        folded = np.zeros(len(self._faces), bool)
        folded[self._solid] = self._neighbours.folded(verts)
        return folded
