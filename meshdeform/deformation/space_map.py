"""Deform an asset by one smooth map of space that gains freedom from coarse to fine.

The Jacobians of a lattice's cells (`lattice_field.py`) are those of a hierarchy of bases::

    J_c = I + sum_l sum_k B_lk(x_c) P(C_lk)

with x_c the centre of cell c and C_l (K_l, 3, 3) the controls of level l, the variables. B_l are the products of
uniform quadratic B-splines over `_SPANS[l]` intervals of the longest side of the mesh's box. The first level has some
60 controls, the second a few hundred; each is unlocked later in the run. So a guidance that knows little about the
shape has no freedom to crumple it: what thousands of free cells would do to a panel, no coarse map can. What is not
built, such as an animal or a ball, gets the cells themselves as the last level.

P keeps what the asset has (`structure.py`). Mirror symmetry: the mean of the controls with their mirror images,
C <- (C + R C' R) / 2 with R the reflection, makes the map commute with it. Level and upright: without the terms that
mix the height with the other axes, what is level stays level, and what is upright upright.

Sources: Sederberg and Parry 1986, Free-form deformation of solid geometric models (here of Jacobians in place of
positions); Forsey and Bartels 1988, Hierarchical B-spline refinement.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.deformation.constraints import UNCONSTRAINED, Constraints
from meshdeform.deformation.lattice import Lattice
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.rigid_bodies import Body
from meshdeform.deformation.structure import Structure
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.rest_mesh import sparse_product

__all__ = ["Level", "SpaceMap"]

_SPANS = (3, 6)
_UNLOCKED = 0.75
"""Share of the run over which the levels are unlocked, evenly."""

_REACHED = 0.1
"""Value of a basis from which its control counts as reaching a cell."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class Level:
    """The controls of one level, and what they add to the Jacobians of the cells.

    Parameters
    ----------
    basis : sparse (C, K) float64, optional
        Values of the bases at the cells; None if each cell has a control of its own.
    partner : (K,) int64
        The control that is each one's mirror image.
    structure : Structure
    """

    def __init__(self, basis: sparse.csr_matrix | None, partner: _Index, structure: Structure) -> None:
        self._basis = basis
        self._plane, self._partner = structure.plane, torch.from_numpy(partner)
        self._free = _LEVEL if structure.level else torch.ones(3, 3, dtype=torch.float64)
        self.controls = torch.zeros(len(partner), 3, 3, dtype=torch.float64).requires_grad_()

    @classmethod
    def of_splines(cls, lattice: Lattice, low: _Floats, high: _Floats, spans: int, structure: Structure) -> Self:
        """Return a level of B-splines with so many intervals along the longest side of a box, constant beyond it."""
        centres = lattice.origin + (lattice.cells + 0.5) * lattice.spacing
        sides = high - low
        counts = [max(1, round(spans * side / sides.max())) + 2 for side in sides]
        along = [_splines((centres[:, a] - low[a]) / max(sides[a], 1e-300), counts[a]) for a in range(3)]
        basis = np.einsum("ci,cj,ck->cijk", *along).reshape(len(centres), -1)
        numbers = np.arange(basis.shape[1]).reshape(counts)
        partner = numbers if structure.plane is None else np.flip(numbers, structure.plane)
        return cls(sparse.csr_matrix(basis), partner.ravel().copy(), structure)

    @classmethod
    def of_cells(cls, lattice: Lattice, structure: Structure) -> Self:
        """Return the level with a control for each cell of a lattice that is its own mirror image."""
        mirrored = lattice.cells.copy()
        if structure.plane is not None:
            last = lattice.shape[structure.plane] - 2
            mirrored[:, structure.plane] = last - lattice.cells[:, structure.plane]
        number = {cell: at for at, cell in enumerate(map(tuple, lattice.cells.tolist()))}
        partner = [number[cell] for cell in map(tuple, mirrored.tolist())]
        return cls(None, np.array(partner), structure)

    def least(self, of_cell: _Floats) -> _Floats:
        """Return the least of 1 and the values (C,) of the cells that each control reaches, (K,)."""
        if self._basis is None:
            return of_cell
        reached = sparse.coo_matrix(self._basis)
        near = reached.data > _REACHED
        least = np.ones(len(self.controls))
        np.minimum.at(least, reached.col[near], of_cell[reached.row[near]])
        return least

    def jacobians(self) -> Tensor:
        """Return what the level adds to the Jacobians, (C, 3, 3), differentiable in `controls`."""
        controls = self.controls * self._free
        if self._plane is not None:
            signs = torch.ones(3, dtype=torch.float64)
            signs[self._plane] = -1
            controls = 0.5 * (controls + signs[:, None] * signs * controls[self._partner])
        if self._basis is None:
            return controls
        return sparse_product(self._basis, controls.reshape(-1, 9)).view(-1, 3, 3)


_LEVEL = torch.tensor([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]], dtype=torch.float64)


class SpaceMap(LatticeField):
    """A hierarchy of controls in place of one Jacobian per cell. Implements `deformation.variables.Variables`.

    Parameters
    ----------
    mesh, whole, bodies, constraints
        As of `LatticeField`.
    structure : Structure
        What the map keeps.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        whole: TriangleMesh | None = None,
        bodies: Sequence[Body] = (),
        constraints: Constraints = UNCONSTRAINED,
        *,
        structure: Structure,
    ) -> None:
        self._plane = structure.plane
        super().__init__(mesh, whole, bodies, constraints)
        verts = self.rest.verts.numpy()[np.unique(self.rest.faces.numpy())]
        box = verts.min(0), verts.max(0)
        self._levels = [Level.of_splines(self.lattice, *box, spans, structure) for spans in _SPANS]
        if not structure.level:
            self._levels.append(Level.of_cells(self.lattice, structure))
        self._unlocked = 1
        self._current: tuple[tuple[bool | int, ...], Tensor] | None = None
        self.tensors = {f"level_{number}": level.controls for number, level in enumerate(self._levels)}

    def _balanced(self, weights: _Floats) -> _Floats:
        """Return the mean of the weights with their mirror images, so that the plane of a symmetric asset stays."""
        lattice, plane = self.lattice, self._plane
        if plane is None:
            return weights
        places = np.stack(np.unravel_index(lattice.keys, lattice.shape), 1)
        places[:, plane] = lattice.shape[plane] - 1 - places[:, plane]
        partner = np.searchsorted(lattice.keys, np.ravel_multi_index(places.T, lattice.shape))
        return np.asarray((weights + weights[partner]) / 2)

    def begin_step(self, fraction: float) -> None:
        """Unlock the levels that are due at this fraction of the run."""
        count = len(self._levels)
        self._unlocked = min(count, 1 + int(fraction * count / _UNLOCKED))
        self._current = None  # its graph may be gone

    def jacobians(self) -> Tensor:
        """Return the Jacobians (C, 3, 3) of the cells; levels that are not unlocked count, but get no gradient."""
        # The loss, the penalties and gradients for regions must meet in one tensor.
        state = (torch.is_grad_enabled(), self._unlocked, *(level.controls._version for level in self._levels))
        if self._current is None or self._current[0] != state:
            found = [level.jacobians() for level in self._levels]
            found[self._unlocked :] = [fixed.detach() for fixed in found[self._unlocked :]]
            self._current = state, torch.stack(found).sum(0) + torch.eye(3, dtype=torch.float64)
        return self._current[1]

    def rows(self, of_element: _Floats) -> dict[str, _Floats]:
        """Return, for each control, the least value of the cells that it reaches with a tenth of its weight or more."""
        return {name: level.least(of_element) for name, level in zip(self.tensors, self._levels, strict=True)}

    def adopt(self, control: Tensor) -> None:
        """Do nothing: a smooth map cannot give any nodes that it is asked for."""


def _splines(at: _Floats, count: int) -> _Floats:
    """Return the values (P, count) of uniform quadratic B-splines over [0, 1], constant beyond it."""
    spans = count - 2
    scaled = np.clip(at, 0, 1) * spans
    first = np.minimum(np.floor(scaled), spans - 1).astype(int)
    f = scaled - first
    values = np.zeros((len(at), count))
    for offset, weight in enumerate((0.5 * (1 - f) ** 2, 0.5 + f - f * f, 0.5 * f * f)):
        values[np.arange(len(at)), first + offset] = weight
    return values
