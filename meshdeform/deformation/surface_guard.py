"""What keeps the surface whole: steps that flip a face or let the surface cut itself are taken back where they did it.

Every few steps the shape is looked at. Faces that were fine at rest and are folded over their neighbours now, or cut
through others, are put back to the last shape that was whole, and their neighbourhood with them, less the farther away
it is::

    J <- J_whole + a_f (J - J_whole)        a_f = 0 on the bad faces, rising to 1 over the rings around them

If that shape is not whole either, what is bad now joins and the rings grow. Two limbs that run into each other are held
by no Jacobian of theirs, for what moves them lies elsewhere: after two rounds it is their positions that are put back,
with rings that double, and the Jacobians become those of that shape. Where not even that helps, the whole step is
shortened, for each connected component that is still bad by itself, at last to nothing: the shape that a run holds is
whole from its first step to its last. The optimiser's momentum of what was put back is forgotten, or it would push on
at once.

What an asset brings along does not hold it back. Faces that are folded at rest, or as good as, may stay so. Components
that cut or touch each other at rest (a head in a collar, a vase on a table) may do so anywhere, and so may the faces
around a place where a component cuts itself. Faces without area at rest have no side to fold to.

The rest of the surface keeps what it gained, which is what plain backtracking (Smith and Schaefer 2015, Bijective
Parameterization with Free Boundaries, section 3.3) gives up: one fold would hold back every other part of the mesh.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.face_blend import FaceBlend
from meshdeform.deformation.optimizer import Adam
from meshdeform.deformation.variables import Variables
from meshdeform.geometry.intersections import cutting_pairs
from meshdeform.geometry.mesh import TriangleMesh, connected_components
from meshdeform.geometry.operators import effective_face_areas
from meshdeform.geometry.quality import FOLD_MARGIN, FaceNeighbours
from meshdeform.requests.document import Safeguard

__all__ = ["EVERY_STEPS", "SurfaceGuard"]

EVERY_STEPS = 5
"""Steps between two looks. A look costs a quarter of a step to a whole one, and a fold needs a few steps to grow."""

_ROUNDS = 2
_FIRST_RINGS = 2
_HOLD_RINGS = (2, 4, 8, 16, 32)
_SHARES = (0.5, 0.25, 0.1, 0.0)
_SHORTENINGS = 16
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
        self._kind, self._variables = kind, variables
        self._faces = mesh.faces.numpy()
        rest = mesh.verts.numpy()
        count = len(self._faces)
        self._partly = FaceBlend(mesh, variables)
        self._copy, self._ramp = self._partly.copy, self._partly.ramp
        self._solid = np.flatnonzero(effective_face_areas(mesh) > 0)
        self._beside = FaceNeighbours(self._faces[self._solid])
        self._part_of_vertex = connected_components(mesh.faces, len(rest)).numpy()
        self._part = self._part_of_vertex[self._faces[:, 0]]
        self._folded = np.zeros(count, bool)
        self._loose = np.zeros(count, bool)
        self._meeting: _Index = np.empty(0, np.int64)
        self._excuse(rest)
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
        """Let be what is broken in this shape, besides what was let be before."""
        self._folded |= self._folds(verts, margin=FOLD_MARGIN)
        if self._kind is not Safeguard.INTERSECTIONS:
            return
        cuts = cutting_pairs(verts, self._faces)
        own = cuts[self._part[cuts[:, 0]] == self._part[cuts[:, 1]]]
        reached = np.bincount(own.ravel(), minlength=len(self._faces)).astype(np.float64)
        for _ in range(_LOOSE_RINGS):
            reached = self._partly.around @ reached
        self._loose |= reached > 0
        keys = [self._meeting, self._keys(cuts)]
        if self._part.max(initial=0) > 0:
            # In contact, and not through each other by a rounding error: a fair share of small disturbances cuts.
            generator = np.random.default_rng(0)
            reach = _CONTACT * float(np.linalg.norm(np.ptp(verts[np.unique(self._faces)], axis=0)))
            for _ in range(_CONTACT_DRAWS):
                disturbed = verts + generator.uniform(-reach, reach, verts.shape)
                keys.append(self._keys(cutting_pairs(disturbed, self._faces)))
        self._meeting = np.unique(np.concatenate(keys))

    def _keys(self, pairs: _Index) -> _Index:
        """One number for each pair of different components that these pairs of faces (P, 2) belong to."""
        parts = np.sort(self._part[pairs], axis=1)
        apart = parts[parts[:, 0] != parts[:, 1]]
        return np.unique(apart[:, 0] * (int(self._part_of_vertex.max(initial=0)) + 1) + apart[:, 1])

    @torch.no_grad()
    def correct(self, optimizer: Adam) -> int:
        """Put back what is broken.

        Returns
        -------
        How many faces were put back: 0 where the shape was whole, those of whole components where nothing else helped.
        """
        wished = self._copy()
        held, carried = np.zeros((2, len(self._faces)), bool)
        for rounds in range(_ROUNDS):
            broken = self._look()
            if not broken.any():
                break
            held |= broken
            self._partly.between(self._whole, wished, self._ramp(held, _FIRST_RINGS + rounds))
        else:
            if self._hold(wished, held):
                # Positions were put back, and the component's translation is a part of them.
                carried = held
            else:
                carried = self._shorten(wished)
                held |= carried
        if held.any():
            self._forget(optimizer, held, carried)
        self._whole = self._copy()
        return int(held.sum())

    def _look(self) -> _Flags:
        """Which faces (F,) are broken and not excused."""
        verts = self._variables.place().detach().numpy()
        broken = self._folds(verts) & ~self._folded
        if self._kind is Safeguard.INTERSECTIONS:
            cuts = cutting_pairs(verts, self._faces)
            first, second = self._part[cuts].T
            low, high = np.minimum(first, second), np.maximum(first, second)
            key = low * (int(self._part_of_vertex.max(initial=0)) + 1) + high
            excused = np.where(low == high, self._loose[cuts].all(1), np.isin(key, self._meeting))
            broken[cuts[~excused].ravel()] = True
        return broken

    def _folds(self, verts: _Floats, *, margin: float = 0.0) -> _Flags:
        folded = np.zeros(len(self._faces), bool)
        folded[self._solid] = self._beside.folded(verts, margin=margin)
        return folded

    def _hold(self, wished: dict[str, Tensor], held: _Flags) -> bool:
        """Put positions back where `held` faces are, and around them; whether that was enough. `held` grows."""
        self._set(self._whole)
        whole = self._variables.place().detach()
        self._set(wished)
        step = self._variables.place().detach() - whole
        for rings in _HOLD_RINGS:
            of_face = self._ramp(held, rings)
            # A vertex goes as far as the most held of its faces.
            of_vertex = np.ones(len(whole))
            np.minimum.at(of_vertex, self._faces.ravel(), np.repeat(of_face, 3))
            self._set(wished)
            self._variables.adopt(whole + torch.from_numpy(of_vertex)[:, None] * step)
            broken = self._look()
            if not broken.any():
                return True
            held |= broken
        self._set(wished)
        return False

    def _set(self, state: dict[str, Tensor]) -> None:
        for name, tensor in self._variables.tensors.items():
            tensor.copy_(state[name])

    def _shorten(self, wished: dict[str, Tensor]) -> _Flags:
        """Shorten the step of every component that is broken until none is; the faces (F,) of those shortened.

        A component that stands still can be run into, so what is broken is looked for anew each time.
        """
        tried = np.zeros(int(self._part_of_vertex.max(initial=0)) + 1, np.int64)
        for _ in range(_SHORTENINGS):
            broken = np.unique(self._part[self._look()])
            if not len(broken):
                break
            tried[broken] = np.minimum(tried[broken] + 1, len(_SHARES))
            self._shorten_to(wished, tried)
        else:
            tried[:] = len(_SHARES)
            self._shorten_to(wished, tried)
        return np.asarray(tried[self._part] > 0)

    def _shorten_to(self, wished: dict[str, Tensor], tried: _Index) -> None:
        """Set every component that was tried to its share of the step; the others keep what they have."""
        share = torch.from_numpy(np.array([1.0, *_SHARES])[tried])
        moved = torch.from_numpy(tried > 0)
        of_face, of_vertex = torch.from_numpy(self._part), torch.from_numpy(self._part_of_vertex)
        for name, tensor in self._variables.tensors.items():
            rows = (
                of_face if name == "jacobians" else of_vertex if name == "displacements" else torch.arange(len(share))
            )
            shape = (-1, *[1] * (tensor.ndim - 1))
            shorter = self._whole[name] + share[rows].view(shape) * (wished[name] - self._whole[name])
            tensor.copy_(torch.where(moved[rows].view(shape), shorter, tensor))

    def _forget(self, optimizer: Adam, held: _Flags, carried: _Flags) -> None:
        """Drop the momentum of what was put back: of `held` faces (F,), and the translation's of `carried` ones."""
        of_part = np.bincount(self._part[carried], minlength=int(self._part_of_vertex.max(initial=0)) + 1) > 0
        of_vertex = self._partly.incidence.T @ held.astype(np.float64) > 0
        rows = {"jacobians": held, "displacements": of_vertex, "translations": of_part}
        for name, tensor in self._variables.tensors.items():
            momentum = optimizer.state.get(tensor, {}).get("exp_avg")
            if momentum is not None:
                momentum[torch.from_numpy(rows[name])] = 0.0
