"""Keep the surface whole: take back steps that flip a face or let the surface cut itself.

Every few steps the shape is looked at. Faces that were fine at rest and are folded over their neighbours now, or cut
through others, are put back to the last shape that was whole, and their neighbourhood in part (`step_repair.py`): the
shape that a run holds is whole from its first step to its last.

What an asset brings along does not hold it back. Faces that are folded at rest, or as good as, may stay so. Components
that cut or touch each other at rest (a head in a collar, a vase on a table) may do so anywhere, and so may the faces
around a place where a component cuts itself. Faces without area at rest have no side to fold to.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.optimizer import Adam
from meshdeform.deformation.step_repair import StepRepair
from meshdeform.deformation.variables import Variables
from meshdeform.geometry.intersections import cutting_pairs
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import FOLD_MARGIN, FaceNeighbours
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.requests.document import Safeguard

__all__ = ["EVERY_STEPS", "SurfaceGuard"]

EVERY_STEPS = 5
"""Steps between two looks. A look costs a quarter of a step to a whole one, and a fold needs a few steps to grow."""

_LOOSE_RINGS = 2
_CONTACT = 1e-4
"""Components that cut each other once every vertex is moved by up to this share of the diagonal touch each other."""
_CONTACT_DRAWS = 5

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class SurfaceGuard:
    """Holds the last whole shape of a run.

    Parameters
    ----------
    kind : Safeguard
        `flips` looks for folds only.
    mesh : TriangleMesh
        At rest; what is folded or cuts there may do so for ever.
    variables : Variables
        At rest.
    """

    def __init__(self, kind: Safeguard, mesh: TriangleMesh, variables: Variables) -> None:
        self._kind, self._variables, self._rest = kind, variables, RestMesh.of(mesh)
        self._faces = self._rest.faces.numpy()
        count = len(self._faces)
        self._repair = StepRepair(self._rest, variables)
        self._copy = self._repair.copy
        self._solid = np.flatnonzero(self._rest.solid)
        self._neighbours = FaceNeighbours(self._faces[self._solid])
        self._component = self._rest.components.numpy()[self._faces[:, 0]]
        self._folded = np.zeros(count, bool)
        self._loose = np.zeros(count, bool)
        self._meeting: _Index = np.empty(0, np.int64)
        self._excuse(self._rest.verts.numpy())
        self._whole = self._copy()

    @property
    def state(self) -> dict[str, Tensor]:
        """The last whole shape and what may stay broken, for checkpoints."""
        whole = {f"guard.{name}": tensor for name, tensor in self._whole.items()}
        excused = {"folded": self._folded, "loose": self._loose, "meeting": self._meeting}
        return {**whole, **{f"guard.{name}": torch.from_numpy(array) for name, array in excused.items()}}

    def begin(self) -> None:
        """Take the variables as they stand for whole, with all that is broken in them."""
        self._excuse(self._variables.place().detach().numpy())
        self._whole = self._copy()

    def restore(self, state: dict[str, Tensor]) -> None:
        """Go on from what `state` gave; a checkpoint of a run without a guard has none of it."""
        if "guard.meeting" not in state:
            self.begin()
            return
        self._folded, self._loose, self._meeting = (
            state[f"guard.{name}"].numpy().copy() for name in ("folded", "loose", "meeting")
        )
        self._whole = {name: state[f"guard.{name}"].clone() for name in self._variables.tensors}

    def _excuse(self, verts: _Floats) -> None:
        """Excuse what is broken in this shape, besides what was excused before."""
        self._folded |= self._folds(verts, margin=FOLD_MARGIN)
        if self._kind is not Safeguard.INTERSECTIONS:
            return
        cuts = cutting_pairs(verts, self._faces)
        own = cuts[self._component[cuts[:, 0]] == self._component[cuts[:, 1]]]
        reached = np.bincount(own.ravel(), minlength=len(self._faces)).astype(np.float64)
        for _ in range(_LOOSE_RINGS):
            reached = self._rest.face_adjacency @ reached
        self._loose |= reached > 0
        keys = [self._meeting, self._keys(cuts)]
        if self._component.max(initial=0) > 0:
            # In contact, and not through each other by a rounding error: a fair share of small disturbances cuts.
            generator = np.random.default_rng(0)
            reach = _CONTACT * float(np.linalg.norm(np.ptp(verts[np.unique(self._faces)], axis=0)))
            for _ in range(_CONTACT_DRAWS):
                disturbed = verts + generator.uniform(-reach, reach, verts.shape)
                keys.append(self._keys(cutting_pairs(disturbed, self._faces)))
        self._meeting = np.unique(np.concatenate(keys))

    def _keys(self, pairs: _Index) -> _Index:
        """One number for each pair of different components that these pairs of faces (P, 2) belong to."""
        parts = np.sort(self._component[pairs], axis=1)
        apart = parts[parts[:, 0] != parts[:, 1]]
        return np.unique(apart[:, 0] * (self._rest.num_components) + apart[:, 1])

    @torch.no_grad()
    def correct(self, optimizer: Adam) -> int:
        """Put back what is broken.

        Returns
        -------
        How many faces were put back: 0 where the shape was whole, those of whole components where nothing else helped.
        """
        held = self._repair.repair(self._look, self._whole, optimizer)
        self._whole = self._copy()
        return int(held.sum())

    def _look(self) -> _Flags:
        """Which faces (F,) are broken and not excused."""
        verts = self._variables.place().detach().numpy()
        broken = self._folds(verts) & ~self._folded
        if self._kind is Safeguard.INTERSECTIONS:
            cuts = cutting_pairs(verts, self._faces)
            first, second = self._component[cuts].T
            low, high = np.minimum(first, second), np.maximum(first, second)
            key = low * (self._rest.num_components) + high
            excused = np.where(low == high, self._loose[cuts].all(1), np.isin(key, self._meeting))
            broken[cuts[~excused].ravel()] = True
        return broken

    def _folds(self, verts: _Floats, *, margin: float = 0.0) -> _Flags:
        folded = np.zeros(len(self._faces), bool)
        folded[self._solid] = self._neighbours.folded(verts, margin=margin)
        return folded
