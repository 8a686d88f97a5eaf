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

A skin is looked at in two shapes: as the file stores it, and in the pose that viewers show. In both nothing may break.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.deformation.optimizer import Adam
from meshdeform.deformation.step_repair import StepRepair
from meshdeform.deformation.variables import Elements, Variables, placed
from meshdeform.geometry.intersections import TooManyPairsError, cutting_pairs, touching_pairs
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import FaceNeighbours
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.samples import count_samples, samples_of
from meshdeform.requests.document import Safeguard

__all__ = ["EVERY_STEPS", "SurfaceGuard"]

EVERY_STEPS = 5
"""Steps between two checks. A check costs a quarter of a step to a whole one, and folds take a few steps to grow."""

_LOOSE_RINGS = 2
_CONTACT, _CONTACT_OF_EDGE = 1e-4, 0.1
"""Faces touch up to this share of the diagonal, and of their longest edge: in dense scans every face is near others."""
_SAMPLES = 20_000_000
"""Points, and pairs of near ones, by which the surroundings of rigid bodies are found."""

_ALLOWED = ("folded", "loose", "meeting", "crowded")
"""Names of the allowed faults of a shape in checkpoints."""

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class WatchedShape:
    """The surface in one shape, as it is deformed or posed: its faults at rest are allowed, others are found.

    Parameters
    ----------
    kind : Safeguard
    rest : RestMesh
        The surface at rest in this shape.
    surface : RestMesh
        The surface that is deformed: its components and its neighbours count.
    pose : (V, 3, 4) float64, optional
        The affine map of each vertex from the deformed surface to this shape. None: the surface itself.
    """

    def __init__(self, kind: Safeguard, rest: RestMesh, surface: RestMesh, pose: _Floats | None = None) -> None:
        self._kind, self._rest, self._surface, self._pose = kind, rest, surface, pose
        self._faces = rest.faces.numpy()
        self.crowded = False
        self._solid = np.flatnonzero(rest.solid)
        self._neighbours = FaceNeighbours(self._faces[self._solid], rest.verts.numpy())
        self._component = surface.components.numpy()[self._faces[:, 0]]
        self._folded, self._loose = np.zeros(len(self._faces), bool), np.zeros(len(self._faces), bool)
        self._meeting: _Index = np.empty(0, np.int64)
        self._allow(rest.verts.numpy())

    @classmethod
    def of_pose(cls, kind: Safeguard, surface: RestMesh, pose: _Floats) -> WatchedShape:
        """Return the shape that these maps (V, 3, 4) make of the surface."""
        posed = TriangleMesh(torch.from_numpy(_posed(pose, surface.verts.numpy())), surface.faces)
        return cls(kind, RestMesh.of(posed), surface, pose)

    @property
    def state(self) -> dict[str, NDArray[np.generic]]:
        """The allowed faults, for checkpoints."""
        allowed: dict[str, NDArray[np.generic]] = {
            "folded": self._folded,
            "loose": self._loose,
            "meeting": self._meeting,
        }
        return {**allowed, "crowded": np.ones(1, bool)} if self.crowded else allowed

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Set the allowed faults to those of `state`."""
        self._folded, self._loose, self._meeting = (
            state[name].numpy().copy() for name in ("folded", "loose", "meeting")
        )
        self.crowded = "crowded" in state

    @property
    def searches(self) -> bool:
        """Whether cuts are found, and not folds alone."""
        return self._kind is Safeguard.INTERSECTIONS and not self.crowded

    def allow(self, verts: _Floats) -> None:
        """Allow the faults that the surface has with these vertices, in addition to those already allowed."""
        self._allow(self._placed(verts))

    def allow_to_meet(self, pairs: _Index) -> None:
        """Allow the components of these pairs of faces (P, 2) to cut each other."""
        self._meeting = np.union1d(self._meeting, self._keys(pairs))

    def find_broken(self, verts: _Floats) -> _Flags:
        """Return flags (F,) of the faces that are broken with these vertices, and not allowed to be."""
        verts = self._placed(verts)
        broken = self._folds(verts) & ~self._folded
        if self.searches:
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

    def _placed(self, verts: _Floats) -> _Floats:
        return verts if self._pose is None else _posed(self._pose, verts)

    def _allow(self, verts: _Floats) -> None:
        """Allow the faults of these vertices, which are those of the shape."""
        self._folded |= self._folds(verts)
        if not self.searches:
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
        self.allow_to_meet(contacts)

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

    def _folds(self, verts: _Floats) -> _Flags:
        folded = np.zeros(len(self._faces), bool)
        folded[self._solid] = self._neighbours.folded(verts)
        return folded


def _posed(pose: _Floats, verts: _Floats) -> _Floats:
    return np.asarray(np.einsum("nij,nj->ni", pose[:, :, :3], verts) + pose[:, :, 3])


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
    """

    def __init__(self, kind: Safeguard, mesh: TriangleMesh, variables: Variables, pose: _Floats | None = None) -> None:
        self._variables, self._rest = variables, RestMesh.of(mesh)
        self._faces = self._rest.faces.numpy()
        self._repair = StepRepair(variables)
        self._copy = self._repair.copy
        self._shapes = {"guard": WatchedShape(kind, self._rest, self._rest)}
        if pose is not None:
            self._shapes["guard.pose"] = WatchedShape.of_pose(kind, self._rest, pose)
        self._allow_near_bodies()
        self._intact = self._copy()

    @property
    def crowded(self) -> bool:
        """Whether a shape had too many pairs of faces that meet; since then only folds are found in it."""
        return any(shape.crowded for shape in self._shapes.values())

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
        allowed = {
            f"{shape}.{name}": torch.from_numpy(array)
            for shape, watched in self._shapes.items()
            for name, array in watched.state.items()
        }
        return {**intact, **allowed}

    def begin(self) -> None:
        """Take the current shape as intact, and allow all its faults."""
        verts = placed(self._variables).detach().numpy()
        for shape in self._shapes.values():
            shape.allow(verts)
        self._intact = self._copy()

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Continue from `state`, or from the current shape if the checkpoint is of a run without this guard."""
        if any(f"{name}.meeting" not in state for name in self._shapes):
            self.begin()
            return
        for name, shape in self._shapes.items():
            shape.restore({key: state[f"{name}.{key}"] for key in _ALLOWED if f"{name}.{key}" in state})
        self._intact = {name: state[f"guard.{name}"].clone() for name in self._variables.tensors}

    def _allow_near_bodies(self) -> None:
        """Allow components to meet of which one has a rigid body within half a cell of the other."""
        rigid = self._variables.elements.rigid
        if rigid is None or not any(shape.searches for shape in self._shapes.values()):
            return
        reach = self._variables.resolution / 2
        if count_samples(self._rest.verts.numpy(), self._faces, reach / 2) > _SAMPLES:
            self._search_no_more()
            return
        points, face = samples_of(self._rest.verts.numpy(), self._faces, reach / 2)
        # One point per component and voxel is enough, and a dense scan has many.
        component = self._rest.components.numpy()[self._faces[face, 0]]
        voxel = np.column_stack([np.floor(points / (reach / 4)), component, rigid[face]]).astype(np.int64)
        kept = np.unique(voxel, axis=0, return_index=True)[1]
        points, face = points[kept], face[kept]
        tree, of_bodies = cKDTree(points), points[rigid[face]]
        if tree.query_ball_point(of_bodies, reach, return_length=True).sum() > _SAMPLES:
            self._search_no_more()
            return
        near = tree.query_ball_point(of_bodies, reach, return_sorted=False)
        owner = np.repeat(face[rigid[face]], [len(points_near) for points_near in near])
        for shape in self._shapes.values():
            shape.allow_to_meet(np.column_stack([owner, face[np.concatenate(near).astype(np.int64)]]))

    def _search_no_more(self) -> None:
        for shape in self._shapes.values():
            shape.crowded = True

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
        """Return flags (F,) of the faces that are broken in one of the shapes and not allowed to be."""
        verts = placed(self._variables).detach().numpy()
        return np.logical_or.reduce([shape.find_broken(verts) for shape in self._shapes.values()])
