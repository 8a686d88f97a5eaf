"""Give the elements of a carrier their Jacobians: each its own, or all by few coefficients, from coarse to fine.

As in the paper, every element (a face of the surface, a cell of a lattice) has a Jacobian of its own, `OwnJacobians`.
That is far more freedom than a prompt has knowledge: thousands of free cells crumple a panel. So what a prompt guides
has the Jacobians of a hierarchy of bases, `Hierarchy`::

    J_e = I + sum_l sum_k B_lk(x_e) P(C_lk)

with x_e the centre of element e and C_l (K_l, 3, 3) the coefficients of level l, the variables. B_l are the products of
uniform quadratic B-splines over `_SPANS[l]` intervals of the longest side of the mesh's box. The first level has some
60 coefficients, the second a few hundred; each is unlocked later in the run. The last level of what is not built, such
as an animal or a ball, are the elements themselves. Man-made things get a third level of splines if it is one surface,
which can bear it: of several parts, more are cut.

P keeps what the asset has (`Structure`). Mirror symmetry: the mean of the coefficients with their mirror images,
C <- (C + R C' R) / 2 with R the reflection, makes the map commute with it. Level and upright: without the terms that
mix the height with the other axes, what is level stays level, and what is upright upright. Either way the
antisymmetric part of the mean of all J_e is taken off them, so that the whole does not turn: an animal does not rear.

Sources: Sederberg and Parry 1986, Free-form deformation of solid geometric models (here of Jacobians in place of
positions); Forsey and Bartels 1988, Hierarchical B-spline refinement.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, Self

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.deformation.differentiable import identity_jacobians
from meshdeform.deformation.structure import NEAR, Structure
from meshdeform.geometry.tensors import sparse_product

_Floats = NDArray[np.float64]
_SPANS = (3, 6)

_SPANS_OF_SURFACES = (3, 6, 12)
"""Of what is built."""

_UNLOCKED = 0.4
"""Share of the run over which the levels are unlocked, evenly."""

_REACHED = 0.1
"""Value of a basis from which its coefficient counts as reaching an element."""

_FACING = 0.05
"""Weight of a normal, as a share of the diagonal, by which a face's mirror image is told from the other side of it."""

_Index = NDArray[np.int64]
_LEVEL = torch.tensor([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]], dtype=torch.float64)


class DegreesOfFreedom(Protocol):
    """Variables that give every element a Jacobian."""

    tensors: dict[str, Tensor]
    """Leaf tensors with gradients, float64, by their names in checkpoints."""

    local: bool
    """Whether every element has a Jacobian of its own, so that `correct` does something."""

    def begin_step(self, fraction: float) -> None:
        """Prepare for the next step, at this fraction of the run: some may not change before their time."""

    def jacobians(self) -> Tensor:
        """Return the Jacobians (E, 3, 3) float64, the same tensor until the variables change."""

    def rows(self, of_element: _Floats) -> dict[str, _Floats]:
        """Return, for each row of each of `tensors`, the least value (E,) among the elements that it reaches."""

    def correct(self, missing: Tensor) -> None:
        """Add to the Jacobians of the elements (E, 3, 3), if each has its own."""


class OwnJacobians:
    """One Jacobian per element, as in the paper. Implements `DegreesOfFreedom`.

    `name`: name of the tensor in checkpoints.
    """

    def __init__(self, name: str, count: int) -> None:
        self.local = True
        self._jacobians = identity_jacobians(count).requires_grad_()
        self.tensors = {name: self._jacobians}

    def begin_step(self, fraction: float) -> None:
        """Do nothing: all elements are free from the first step on."""

    def jacobians(self) -> Tensor:
        """Return the variables themselves."""
        return self._jacobians

    def rows(self, of_element: _Floats) -> dict[str, _Floats]:
        """Return the argument: there is a row per element."""
        return dict.fromkeys(self.tensors, of_element)

    def correct(self, missing: Tensor) -> None:
        """Add to the Jacobians."""
        self._jacobians += missing


class BasisLevel:
    """The coefficients of one level, and what they add to the Jacobians of the elements.

    Parameters
    ----------
    basis : sparse (E, K) float64, optional
        Values of the bases at the elements; None if each element has a coefficient.
    count : int
        K.
    partners : sequence of (K,) int64
        For each mirror plane, the coefficient that is each one's mirror image.
    """

    def __init__(
        self, basis: sparse.csr_matrix | None, count: int, partners: Sequence[_Index], structure: Structure
    ) -> None:
        self._basis = basis
        partnered = zip(structure.planes, map(torch.from_numpy, partners), strict=True)
        self._mirrors = [(torch.from_numpy(_reflection(plane)), partner) for plane, partner in partnered]
        self._free = _LEVEL if structure.level else torch.ones(3, 3, dtype=torch.float64)
        self.coefficients = torch.zeros(count, 3, 3, dtype=torch.float64).requires_grad_()

    @classmethod
    def of_splines(cls, centres: _Floats, low: _Floats, high: _Floats, spans: int, structure: Structure) -> Self:
        """Return a level of B-splines with so many intervals along the longest side of a box, constant beyond it."""
        sides = high - low
        counts = [max(1, round(spans * side / sides.max())) + 2 for side in sides]
        along = [_splines((centres[:, a] - low[a]) / max(sides[a], 1e-300), counts[a]) for a in range(3)]
        basis = np.einsum("ei,ej,ek->eijk", *along).reshape(len(centres), -1)
        numbers = np.arange(basis.shape[1]).reshape(counts)
        partners = [np.flip(numbers, plane).ravel().copy() for plane in structure.planes]
        return cls(sparse.csr_matrix(basis), basis.shape[1], partners, structure)

    @classmethod
    def of_elements(
        cls, centres: _Floats, normals: _Floats | None, middle: _Floats, structure: Structure
    ) -> Self | None:
        """Return the level with a coefficient for each element and its partner, the nearest to its mirror image."""
        reach = _FACING * float(np.linalg.norm(np.ptp(centres, axis=0)))
        facing = np.zeros_like(centres) if normals is None else reach * normals
        tree = cKDTree(np.hstack([centres, facing]))
        across = [_reflection(plane) for plane in structure.planes]
        matches = [tree.query(np.hstack([middle + signs * (centres - middle), signs * facing])) for signs in across]
        if len(matches) > 1 and max(apart.mean() for apart, _ in matches) > NEAR * reach:
            return None  # what is to be round would lean
        return cls(None, len(centres), [partner.astype(np.int64) for _, partner in matches], structure)

    def least(self, of_element: _Floats) -> _Floats:
        """Return the least of 1 and the values (E,) of the elements that each coefficient reaches, (K,).

        Of one that reaches none with a tenth of its weight, the greatest: else it would never be held, and a step
        that is to be taken back in whole would not be.
        """
        if self._basis is None:
            return of_element
        reached = sparse.coo_matrix(self._basis)
        near = reached.data > _REACHED
        least = np.ones(len(self.coefficients))
        np.minimum.at(least, reached.col[near], of_element[reached.row[near]])
        weak = np.bincount(reached.col[near], minlength=len(least)) == 0
        greatest = np.full(len(least), of_element.min())
        np.maximum.at(greatest, reached.col[reached.data > 0], of_element[reached.row[reached.data > 0]])
        return np.where(weak, np.minimum(greatest, 1.0), least)

    def jacobians(self) -> Tensor:
        """Return the level's part of the Jacobians, (E, 3, 3), differentiable in `coefficients`."""
        coefficients = self.coefficients * self._free
        for signs, partner in self._mirrors:
            coefficients = 0.5 * (coefficients + signs[:, None] * signs * coefficients[partner])
        if self._basis is None:
            return coefficients
        return sparse_product(self._basis, coefficients.reshape(-1, 9)).view(-1, 3, 3)


def _reflection(plane: int) -> _Floats:
    """Return the signs (3,) of the axes in a mirror image."""
    signs = np.ones(3)
    signs[plane] = -1
    return signs


class Hierarchy:
    """Levels of coefficients. Implements `DegreesOfFreedom`.

    `name`: of the elements, with which the names of the tensors in checkpoints begin; `centres`, (E, 3) float64: of the
    elements, in object units; `normals`, (E, 3) float64: unit normals of elements that are faces; `box`, pair of (3,)
    float64: the lowest and the highest corner of the mesh's box; `structure`: what the map keeps.
    """

    def __init__(
        self,
        name: str,
        centres: _Floats,
        normals: _Floats | None,
        box: tuple[_Floats, _Floats],
        structure: Structure,
    ) -> None:
        low, high = box
        self._own = None if structure.level else BasisLevel.of_elements(centres, normals, (low + high) / 2, structure)
        chosen = _SPANS_OF_SURFACES if self._own is None and normals is not None else _SPANS
        self._levels = [BasisLevel.of_splines(centres, low, high, spans, structure) for spans in chosen]
        self.local = self._own is not None
        if self._own is not None:
            self._levels.append(self._own)
        self._keeps = structure != Structure()
        self._unlocked = 1
        self._current: tuple[tuple[bool | int, ...], Tensor] | None = None
        self.tensors = {f"{name}_level_{number}": level.coefficients for number, level in enumerate(self._levels)}

    def begin_step(self, fraction: float) -> None:
        """Unlock the levels that are due at this fraction of the run."""
        count = len(self._levels)
        self._unlocked = min(count, 1 + int(fraction * count / _UNLOCKED))
        self._current = None  # its graph may be gone

    def jacobians(self) -> Tensor:
        """Return the Jacobians; levels that are not unlocked count, but get no gradient."""
        # The loss, the penalties and gradients for regions must meet in one tensor.
        state = (torch.is_grad_enabled(), self._unlocked, *(level.coefficients._version for level in self._levels))
        if self._current is None or self._current[0] != state:
            added = [level.jacobians() for level in self._levels]
            added[self._unlocked :] = [fixed.detach() for fixed in added[self._unlocked :]]
            jacobians = torch.stack(added).sum(0) + torch.eye(3, dtype=torch.float64)
            mean = jacobians.mean(0)
            self._current = state, jacobians - (mean - mean.T) / 2 * self._keeps
        return self._current[1]

    def rows(self, of_element: _Floats) -> dict[str, _Floats]:
        """Return, for each coefficient, the least value of the elements that it reaches with a tenth of its weight."""
        return {name: level.least(of_element) for name, level in zip(self.tensors, self._levels, strict=True)}

    def correct(self, missing: Tensor) -> None:
        """Add to the last level, if it is that of the elements: a smooth map cannot give whatever it is asked for."""
        if self._own is not None:
            self._own.coefficients += missing


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
