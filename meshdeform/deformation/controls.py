"""Give the elements of a carrier their Jacobians: each its own, or all by a few controls, from coarse to fine.

As in the paper, every element (a face of the surface, a cell of a lattice) has a Jacobian of its own, `OwnJacobians`.
That is far more freedom than a prompt has knowledge: thousands of free cells crumple a panel. So what a prompt guides
has the Jacobians of a hierarchy of bases, `Hierarchy`::

    J_e = I + sum_l sum_k B_lk(x_e) P(C_lk)

with x_e the centre of element e and C_l (K_l, 3, 3) the controls of level l, the variables. B_l are the products of
uniform quadratic B-splines over `_SPANS[l]` intervals of the longest side of the mesh's box. The first level has some
60 controls, the second a few hundred; each is unlocked later in the run. The last level of what is not built, such as
an animal or a ball, are the elements themselves. Man-made things get a third level of splines if it is one surface,
which can bear it: of several parts, more are cut.

P keeps what the asset has (`Structure`). Mirror symmetry: the mean of the controls with their mirror images,
C <- (C + R C' R) / 2 with R the reflection, makes the map commute with it. Level and upright: without the terms that
mix the height with the other axes, what is level stays level, and what is upright upright. Either way the
antisymmetric part of the mean of all J_e is taken off them, so that the whole does not turn: an animal does not rear.

Sources: Sederberg and Parry 1986, Free-form deformation of solid geometric models (here of Jacobians in place of
positions); Forsey and Bartels 1988, Hierarchical B-spline refinement.

`Structure` has the mirror planes of an asset, and whether it stands level and upright. A plane counts if most of the
surface has a mirror image close by, so that a few parts may lack one, or if nearly all of it has one not far off, as an
animal in the middle of a step; a second plane only if it is as good. Of two, the one in which the front lies is kept,
since nearly all things have a front; both are if the result has none: a vase leans without the second. Things that are
built have most of their area along few directions, and of those every wall should stay upright and every shelf level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import ConvexHull, cKDTree
from torch import Tensor

from meshdeform.deformation.differentiable import identity_jacobians
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.places import NearestPlaces, even_samples
from meshdeform.geometry.tensors import sparse_product

_SAMPLES = 5000

_NEAR = 0.006
"""Distance of a mirror image from the surface that counts as none, as a share of the diagonal."""

_MATCHED = 0.8
"""Share of the surface that must have a mirror image."""

_NOT_FAR, _NEARLY_ALL = 0.03, 0.93

_AS_GOOD = 0.02
"""How much smaller the matched share of the second plane may be, for both to count."""

_ALONG = 0.98
"""Cosine from which a normal is along an axis."""

_BUILT, _EACH = 0.5, 0.05
"""Share of the area along the axes from which a thing counts as built, and of its upright and its level faces."""

_CONVEX = 0.01
"""By which share the areas of a surface and its convex hull may differ if it counts as convex."""

_Floats = NDArray[np.float64]
_SPANS = (3, 6)

_SPANS_OF_SURFACES = (3, 6, 12)
"""Of what is built."""

_UNLOCKED = 0.4
"""Share of the run over which the levels are unlocked, evenly."""

_REACHED = 0.1
"""Value of a basis from which its control counts as reaching an element."""

_FACING = 0.05
"""Weight of a normal, as a share of the diagonal, by which a face's mirror image is told from the other side of it."""

_Index = NDArray[np.int64]


@dataclass(frozen=True)
class Structure:
    """Properties of an asset that few controls keep."""

    planes: tuple[int, ...] = ()  # axes to which the mirror planes, through the middle of the box, are perpendicular
    level: bool = False  # whether what is level stays level, and what is upright upright

    def to_tensor(self) -> Tensor:
        """Return the members as int64, for checkpoints."""
        return torch.tensor([*(self.planes or (-1,)), int(self.level)])

    @classmethod
    def from_tensor(cls, values: Tensor) -> Self:
        """Return the structure that `to_tensor` stored."""
        *planes, level = values.tolist()
        return cls(tuple(plane for plane in planes if plane >= 0), bool(level))


def mirror_planes(mesh: RestMesh) -> tuple[int, ...]:
    """Return the axes, of 0 and 2, to which the upright mirror planes of a surface are perpendicular."""
    low, high = mesh.box
    matched, diagonal, axes = {}, float(np.linalg.norm(high - low)), (0, 2)
    for axis, (mirrored, places) in zip(axes, NearestPlaces.of_mirrored(mesh, _places(mesh), axes), strict=True):
        distances = places.distances(mirrored) / diagonal
        close = float((distances < _NEAR).mean())
        if close >= _MATCHED or (distances < _NOT_FAR).mean() >= _NEARLY_ALL:
            matched[axis] = close
    return tuple(axis for axis, share in matched.items() if share >= max(matched.values()) - _AS_GOOD)


def plane_of(planes: Sequence[int], front_deg: float) -> tuple[int, ...]:
    """Return the plane to keep, of those with these normals: the one in which the front lies, if there are two."""
    containing = 0 if abs(math.cos(math.radians(front_deg))) > math.sqrt(0.5) else 2
    return (containing,) if containing in planes else tuple(planes[:1])


@dataclass(frozen=True)
class Nature:
    """What is known of a source and of what it is to become."""

    built: bool = False  # whether it is something that people build
    grown: bool = False  # whether it is to become something that nobody builds, such as an animal or a plant
    crooked: bool = False  # whether it is to be twisted, leaning or bent
    turned: bool = False  # whether it is to become something that is alike from all sides, such as a vase


UNKNOWN = Nature()


def structure_of(mesh: RestMesh, nature: Nature, front_deg: float, *, several: bool) -> Structure:
    """Return what few controls keep of a mesh with its front at an azimuth; `several`: a lattice carries its parts."""
    if nature.crooked:
        return Structure()
    planes = mirror_planes(mesh)
    # Splines alone cannot keep collinear faces from cutting their neighbours.
    turned = nature.turned and len(planes) == 2 and bool(mesh.areas.min() > 0)
    built = is_level(mesh) or (nature.built and not turned and not is_block(mesh))
    # A building can only become an animal if it bends, which the parts of an asset would not survive.
    level = built and (several or not nature.grown)
    return Structure(planes if turned else plane_of(planes, front_deg), level)


def is_level(mesh: RestMesh) -> bool:
    """Return whether most of the area faces along an axis, a part of it up or down and to a side: a built thing.

    A block is none: it is to be shaped, and has no wall or shelf that must stay one.
    """
    return _along_axes(mesh) and not is_convex(mesh)


def is_block(mesh: RestMesh) -> bool:
    """Return whether a mesh is a convex block along the axes, whatever it is taken for: clay to be shaped."""
    return _along_axes(mesh) and is_convex(mesh)


def _along_axes(mesh: RestMesh) -> bool:
    along = np.abs(mesh.normals) > _ALONG
    upright, level = (mesh.areas[faces].sum() / mesh.areas.sum() for faces in (along[:, ::2].any(1), along[:, 1]))
    return bool(upright + level > _BUILT and min(upright, level) > _EACH)


def is_convex(mesh: RestMesh) -> bool:
    """Return whether a surface is that of its convex hull; a single triangle encloses nothing, and has none."""
    verts = mesh.verts
    if len(verts) <= verts.shape[1]:
        return False
    hull = ConvexHull(verts, qhull_options="QJ")  # also of what is flat
    return bool(abs(float(mesh.areas.sum()) / hull.area - 1) < _CONVEX)


def _places(mesh: RestMesh) -> _Floats:
    """Return places (P, 3) spread evenly over the surface."""
    face, weights = even_samples(mesh.areas, _SAMPLES, seed=0)
    return np.asarray((weights[..., None] * mesh.verts[mesh.faces[face]]).sum(1))


class Controls(Protocol):
    """Variables that give every element a Jacobian."""

    tensors: dict[str, Tensor]
    """Leaf tensors with gradients, float64, by their names in checkpoints."""

    local: bool
    """Whether every element has a Jacobian of its own, so that `correct` does something."""

    def begin_step(self, fraction: float) -> None:
        """Prepare for the next step, at this fraction of the run: some controls may not change before their time."""

    def jacobians(self) -> Tensor:
        """Return the Jacobians (E, 3, 3) float64, the same tensor until the variables change."""

    def rows(self, of_element: _Floats) -> dict[str, _Floats]:
        """Return, for each row of each of `tensors`, the least value (E,) among the elements that it reaches."""

    def correct(self, missing: Tensor) -> None:
        """Add to the Jacobians of the elements (E, 3, 3), if each has its own."""


class OwnJacobians:
    """One Jacobian per element, as in the paper. Implements `Controls`.

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


class Level:
    """The controls of one level, and what they add to the Jacobians of the elements.

    Parameters
    ----------
    basis : sparse (E, K) float64, optional
        Values of the bases at the elements; None if each element has a control.
    count : int
        K.
    partners : sequence of (K,) int64
        For each mirror plane, the control that is each one's mirror image.
    """

    def __init__(
        self, basis: sparse.csr_matrix | None, count: int, partners: Sequence[_Index], structure: Structure
    ) -> None:
        self._basis = basis
        partnered = zip(structure.planes, map(torch.from_numpy, partners), strict=True)
        self._mirrors = [(torch.from_numpy(_reflection(plane)), partner) for plane, partner in partnered]
        self._free = _LEVEL if structure.level else torch.ones(3, 3, dtype=torch.float64)
        self.controls = torch.zeros(count, 3, 3, dtype=torch.float64).requires_grad_()

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
        """Return the level with a control for each element and its partner, the nearest to its mirror image."""
        reach = _FACING * float(np.linalg.norm(np.ptp(centres, axis=0)))
        facing = np.zeros_like(centres) if normals is None else reach * normals
        tree = cKDTree(np.hstack([centres, facing]))
        across = [_reflection(plane) for plane in structure.planes]
        matches = [tree.query(np.hstack([middle + signs * (centres - middle), signs * facing])) for signs in across]
        if len(matches) > 1 and max(apart.mean() for apart, _ in matches) > _NEAR * reach:
            return None  # what is to be round would lean
        return cls(None, len(centres), [partner.astype(np.int64) for _, partner in matches], structure)

    def least(self, of_element: _Floats) -> _Floats:
        """Return the least of 1 and the values (E,) of the elements that each control reaches, (K,).

        Of a control that reaches none with a tenth of its weight, the greatest: else it would never be held, and a step
        that is to be taken back in whole would not be.
        """
        if self._basis is None:
            return of_element
        reached = sparse.coo_matrix(self._basis)
        near = reached.data > _REACHED
        least = np.ones(len(self.controls))
        np.minimum.at(least, reached.col[near], of_element[reached.row[near]])
        weak = np.bincount(reached.col[near], minlength=len(least)) == 0
        greatest = np.full(len(least), of_element.min())
        np.maximum.at(greatest, reached.col[reached.data > 0], of_element[reached.row[reached.data > 0]])
        return np.where(weak, np.minimum(greatest, 1.0), least)

    def jacobians(self) -> Tensor:
        """Return the level's part of the Jacobians, (E, 3, 3), differentiable in `controls`."""
        controls = self.controls * self._free
        for signs, partner in self._mirrors:
            controls = 0.5 * (controls + signs[:, None] * signs * controls[partner])
        if self._basis is None:
            return controls
        return sparse_product(self._basis, controls.reshape(-1, 9)).view(-1, 3, 3)


def _reflection(plane: int) -> _Floats:
    """Return the signs (3,) of the axes in a mirror image."""
    signs = np.ones(3)
    signs[plane] = -1
    return signs


_LEVEL = torch.tensor([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]], dtype=torch.float64)


class Hierarchy:
    """A hierarchy of controls. Implements `Controls`.

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
        self._own = None if structure.level else Level.of_elements(centres, normals, (low + high) / 2, structure)
        chosen = _SPANS_OF_SURFACES if self._own is None and normals is not None else _SPANS
        self._levels = [Level.of_splines(centres, low, high, spans, structure) for spans in chosen]
        self.local = self._own is not None
        if self._own is not None:
            self._levels.append(self._own)
        self._keeps = structure != Structure()
        self._unlocked = 1
        self._current: tuple[tuple[bool | int, ...], Tensor] | None = None
        self.tensors = {f"{name}_level_{number}": level.controls for number, level in enumerate(self._levels)}

    def begin_step(self, fraction: float) -> None:
        """Unlock the levels that are due at this fraction of the run."""
        count = len(self._levels)
        self._unlocked = min(count, 1 + int(fraction * count / _UNLOCKED))
        self._current = None  # its graph may be gone

    def jacobians(self) -> Tensor:
        """Return the Jacobians; levels that are not unlocked count, but get no gradient."""
        # The loss, the penalties and gradients for regions must meet in one tensor.
        state = (torch.is_grad_enabled(), self._unlocked, *(level.controls._version for level in self._levels))
        if self._current is None or self._current[0] != state:
            added = [level.jacobians() for level in self._levels]
            added[self._unlocked :] = [fixed.detach() for fixed in added[self._unlocked :]]
            jacobians = torch.stack(added).sum(0) + torch.eye(3, dtype=torch.float64)
            mean = jacobians.mean(0)
            self._current = state, jacobians - (mean - mean.T) / 2 * self._keeps
        return self._current[1]

    def rows(self, of_element: _Floats) -> dict[str, _Floats]:
        """Return, for each control, the least value of the elements that it reaches with a tenth of its weight."""
        return {name: level.least(of_element) for name, level in zip(self.tensors, self._levels, strict=True)}

    def correct(self, missing: Tensor) -> None:
        """Add to the last level, if it is that of the elements: a smooth map cannot give whatever it is asked for."""
        if self._own is not None:
            self._own.controls += missing


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
