"""What keeps the surface whole: steps that flip a face or let the surface cut itself are taken back where they did it.

Every few steps the shape is looked at. Faces that were fine at rest and are folded over their neighbours now, or cut
through others, are put back to the last shape that was whole, and their neighbourhood with them, less the farther away
it is::

    J <- J_whole + a_f (J - J_whole)        a_f = 0 on the bad faces, rising to 1 over the rings around them

If that shape is not whole either, what is bad now joins, the rings grow, and after a few rounds the whole step is
shortened, at last to nothing: the shape that a run holds is whole from its first step to its last. The optimiser's
momentum of what was put back is forgotten, or it would push on at once.

The rest of the surface keeps what it gained, which is what plain backtracking (Smith and Schaefer 2015, Bijective
Parameterization with Free Boundaries, section 3.3) gives up: one fold would hold back every other part of the mesh.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.config import Safeguard
from meshdeform.intersections import intersecting_faces
from meshdeform.mesh import TriangleMesh
from meshdeform.quality import folded_faces
from meshdeform.variables import Variables

__all__ = ["EVERY_STEPS", "SurfaceGuard"]

EVERY_STEPS = 5
"""Steps between two looks. A look costs a quarter of a step to a whole one, and a fold needs a few steps to grow."""

_ROUNDS = 6
_FIRST_RINGS = 2
_SHARES = (0.5, 0.25, 0.1)

_Flags = NDArray[np.bool_]


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
        self._excused = self._broken(rest)
        count = len(self._faces)
        corner = np.arange(3 * count) // 3
        incidence = sparse.csr_matrix((np.ones(3 * count), (corner, self._faces.ravel())), shape=(count, len(rest)))
        self._around = (incidence @ incidence.T).tocsr()
        self._incidence = incidence
        self._whole = self._copy()

    @property
    def state(self) -> dict[str, Tensor]:
        """The last whole shape and what may stay broken, for checkpoints."""
        whole = {f"guard.{name}": tensor for name, tensor in self._whole.items()}
        return {**whole, "guard.excused": torch.from_numpy(self._excused)}

    def begin(self) -> None:
        """Take the variables as they stand for whole, with all that is broken in them."""
        self._excused |= self._broken(self._variables.place().detach().numpy())
        self._whole = self._copy()

    def restore(self, state: dict[str, Tensor]) -> None:
        """Go on from what `state` gave; a checkpoint of a run without a guard has none of it."""
        if "guard.excused" not in state:
            self.begin()
            return
        self._excused = state["guard.excused"].numpy().copy()
        self._whole = {name: state[f"guard.{name}"].clone() for name in self._variables.tensors}

    @torch.no_grad()
    def correct(self, optimizer: torch.optim.Optimizer) -> int:
        """Put back what is broken.

        Returns
        -------
        How many faces were put back: 0 where the shape was whole, all where nothing else helped.
        """
        wished = self._copy()
        held = np.zeros(len(self._faces), bool)
        for rounds in range(_ROUNDS):
            broken = self._look()
            if not broken.any():
                break
            held |= broken
            self._blend(wished, self._ramp(held, _FIRST_RINGS + rounds))
        else:
            held[:] = True
            self._shorten(wished)
        if held.any():
            self._forget(optimizer, held)
        self._whole = self._copy()
        return int(held.sum())

    def _look(self) -> _Flags:
        return self._broken(self._variables.place().detach().numpy()) & ~self._excused

    def _broken(self, verts: NDArray[np.float64]) -> _Flags:
        broken = folded_faces(verts, self._faces)
        if self._kind is Safeguard.INTERSECTIONS:
            broken = broken | intersecting_faces(verts, self._faces)
        return broken

    def _copy(self) -> dict[str, Tensor]:
        return {name: tensor.detach().clone() for name, tensor in self._variables.tensors.items()}

    def _ramp(self, held: _Flags, rings: int) -> NDArray[np.float64]:
        """0 on the held faces, then 1 / (rings + 1) more with every ring of faces around them."""
        share = np.ones(len(held))
        reached = held.astype(np.float64)
        share[held] = 0.0
        for ring in range(rings):
            reached = ((self._around @ reached) > 0).astype(np.float64)
            share = np.where(reached > 0, np.minimum(share, (ring + 1) / (rings + 1)), share)
        return share

    def _blend(self, wished: dict[str, Tensor], share: NDArray[np.float64]) -> None:
        """Set the variables between the last whole shape (0) and the wished one (1), face by face."""
        of_face = torch.from_numpy(share)
        of_vertex = torch.from_numpy(1 - (self._incidence.T @ (1 - share) > 0))
        for name, tensor in self._variables.tensors.items():
            rows = {len(of_face): of_face, len(of_vertex): of_vertex}.get(len(tensor))
            if rows is None or name == "translations":
                continue  # parts move as a whole; only shortening the step holds them back
            whole = self._whole[name]
            tensor.copy_(whole + rows.view(-1, *[1] * (tensor.ndim - 1)) * (wished[name] - whole))

    def _shorten(self, wished: dict[str, Tensor]) -> None:
        for share in (*_SHARES, 0.0):
            for name, tensor in self._variables.tensors.items():
                tensor.copy_(self._whole[name] + share * (wished[name] - self._whole[name]))
            if share == 0.0 or not self._look().any():
                return

    def _forget(self, optimizer: torch.optim.Optimizer, held: _Flags) -> None:
        """Drop the momentum of what was put back."""
        of_vertex = self._incidence.T @ held.astype(np.float64) > 0
        for tensor in self._variables.tensors.values():
            momentum = optimizer.state.get(tensor, {}).get("exp_avg")
            if momentum is None:
                continue
            rows = {len(held): held, len(of_vertex): of_vertex}.get(len(tensor))
            if rows is not None:
                momentum[torch.from_numpy(rows)] = 0.0
