"""Displacements that are tensor products of uniform quadratic B-splines over a box, even or odd across mirror planes.

The coordinate c of a displacement is u_c(x) = sum_k a_k b_i(x_0) b_j(x_1) b_l(x_2). Across a mirror plane, the
coordinate along its normal is odd and the others are even, so that x -> x + u(x) commutes with the reflection: points
are folded to one side of the plane, and the splines that the reflection takes to each other share one number. Then
mirror images go to mirror images exactly, not only up to rounding.

The bending energy of a coordinate is the mean over the box of the squared second derivatives,

    u_xx^2 + u_yy^2 + u_zz^2 + 2 (u_xy^2 + u_xz^2 + u_yz^2),

by products of integrals along the axes.

Sources: de Boor 1978, A Practical Guide to Splines; Rueckert et al. 1999, Nonrigid registration using free-form
deformations (the bending energy); Eilers and Marx 1996, Flexible smoothing with B-splines and penalties.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from scipy import sparse

from meshdeform.nouns.labels import Floats, Index

__all__ = ["SplineGrid", "Terms"]

_BLOCK = 20_000
"""Places that are evaluated at a time."""
_POINTS = 4
"""Places in each interval at which the integrals are taken."""
_SECOND = {(2, 0, 0): 1.0, (0, 2, 0): 1.0, (0, 0, 2): 1.0, (1, 1, 0): 2.0, (1, 0, 1): 2.0, (0, 1, 1): 2.0}
"""The weight of each second derivative, by how often it is taken along every axis."""


class Terms(NamedTuple):
    """The splines that are not 0 at some points: their numbers (P, 27) int64 and their values (P, 27) float64."""

    columns: Index
    values: Floats


class _Axis(NamedTuple):
    """The splines along one axis for one coordinate: how many numbers they have, and the number and sign of each."""

    size: int
    number: Index
    sign: Floats


class _AxisSamples(NamedTuple):
    """Places along one axis: the first spline of each that is not 0, values and slopes (P, 3), side of the plane."""

    first: Index
    values: Floats
    slopes: Floats
    side: Floats


class SplineGrid:
    """The splines over a box from `low` to `high` (3,), as many intervals along its longest side as `spans` says.

    `planes`: the axes across whose middle the displacement is symmetric. The numbers of coordinate c are those from
    `offsets[c]` to `offsets[c + 1]`.
    """

    def __init__(self, low: Floats, high: Floats, spans: int, planes: Collection[int] = ()) -> None:
        self._middle, self._sides = (low + high) / 2, np.maximum(high - low, 1e-9 * np.max(high - low))
        self._spans = [max(1, round(spans * side / self._sides.max())) for side in self._sides]
        self._planes = frozenset(planes)
        self._axes = [[self._axis(axis, coordinate) for axis in range(3)] for coordinate in range(3)]
        sizes = [int(np.prod([axis.size for axis in axes])) for axes in self._axes]
        self.offsets = np.concatenate([[0], np.cumsum(sizes)])
        self.count = int(self.offsets[-1])

    def _axis(self, axis: int, coordinate: int) -> _Axis:
        """Return the splines along an axis: of those across a plane, mirror images share a number."""
        count = self._spans[axis] + 2
        number = np.arange(count)
        if axis not in self._planes:
            return _Axis(count, number, np.ones(count))
        folded = np.minimum(number, count - 1 - number)
        if axis != coordinate:
            return _Axis((count + 1) // 2, folded, np.ones(count))
        # The spline in the middle, if there is one, is even: it has the sign 0.
        return _Axis(count // 2, np.minimum(folded, count // 2 - 1), np.sign(2.0 * number + 1 - count))

    def _along_axes(self, positions: Floats) -> list[_AxisSamples]:
        """Return points (P, 3) along the axes; across a plane, those of the lower side as their mirror images."""
        samples = []
        for axis in range(3):
            from_middle = (positions[:, axis] - self._middle[axis]) / self._sides[axis]
            side = np.sign(from_middle) if axis in self._planes else np.ones(len(positions))
            at = np.abs(from_middle) if axis in self._planes else from_middle
            first, values, slopes, _ = _quadratic(0.5 + at, self._spans[axis])
            samples.append(_AxisSamples(first, values, slopes / self._sides[axis], side))
        return samples

    def _terms(self, samples: list[_AxisSamples], coordinate: int, along: int | None) -> Terms:
        """Return the splines of a coordinate, or their derivatives along an axis."""
        columns, values = [], []
        for axis, sample in enumerate(samples):
            known = self._axes[coordinate][axis]
            here = sample.first[:, None] + np.arange(3)
            value = (sample.slopes if axis == along else sample.values) * known.sign[here]
            if axis in self._planes and (axis == coordinate) != (axis == along):  # odd across the plane
                value = value * sample.side[:, None]
            columns.append(known.number[here])
            values.append(value)
        sizes = [axis.size for axis in self._axes[coordinate]]
        column = columns[0][:, :, None] * sizes[1] + columns[1][:, None, :]
        column = column[:, :, :, None] * sizes[2] + columns[2][:, None, None, :]
        value = values[0][:, :, None, None] * values[1][:, None, :, None] * values[2][:, None, None, :]
        count = len(column)
        return Terms(column.reshape(count, 27) + self.offsets[coordinate], value.reshape(count, 27))

    def terms(self, positions: Floats) -> list[Terms]:
        """Return the splines of the three coordinates at points (P, 3)."""
        samples = self._along_axes(positions)
        return [self._terms(samples, coordinate, None) for coordinate in range(3)]

    def gradients(self, positions: Floats) -> Terms:
        """Return the derivatives of the splines at points (P, 3), (9 P, 27): du_0/dx_0 of all, du_0/dx_1, and so on."""
        samples = self._along_axes(positions)
        found = [self._terms(samples, coordinate, axis) for coordinate in range(3) for axis in range(3)]
        return Terms(np.concatenate([each.columns for each in found]), np.concatenate([each.values for each in found]))

    def displacements(self, positions: Floats, numbers: Floats) -> Floats:
        """Return the displacements (P, 3) of points by the numbers (K,) of all splines."""
        moved = np.empty((len(positions), 3))
        for start in range(0, len(positions), _BLOCK):
            rows = slice(start, start + _BLOCK)
            for coordinate, (columns, values) in enumerate(self.terms(positions[rows])):
                moved[rows, coordinate] = np.einsum("pk,pk->p", values, numbers[columns])
        return moved

    def matrix(self, terms: Terms) -> sparse.csr_matrix:
        """Return the rows (P, K) that take the numbers of all splines to what the terms are of."""
        count, width = terms.columns.shape
        pointers = np.arange(count + 1) * width
        return sparse.csr_matrix((terms.values.ravel(), terms.columns.ravel(), pointers), (count, self.count))

    def bending(self) -> sparse.csr_matrix:
        """Return the matrix (K, K) of the bending energies of the three coordinates."""
        return sparse.block_diag([self._bending(coordinate) for coordinate in range(3)]).tocsr()

    def _bending(self, coordinate: int) -> sparse.csr_matrix:
        integrals = [self._integrals(axis, coordinate) for axis in range(3)]
        pairs = [np.nonzero(np.abs(along).sum(0)) for along in integrals]
        values = np.zeros([len(rows) for rows, _ in pairs])
        for orders, weight in _SECOND.items():
            x, y, z = (integrals[axis][order][pairs[axis]] for axis, order in enumerate(orders))
            values += weight * x[:, None, None] * y[None, :, None] * z
        sizes = [axis.size for axis in self._axes[coordinate]]
        rows, columns = (
            (pairs[0][k][:, None, None] * sizes[1] + pairs[1][k][None, :, None]) * sizes[2] + pairs[2][k]
            for k in range(2)
        )
        count = int(np.prod(sizes))
        return sparse.csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), (count, count))

    def _integrals(self, axis: int, coordinate: int) -> list[Floats]:
        """Return the mean products of the splines along an axis, of their slopes and of their second derivatives."""
        spans, side, known = self._spans[axis], self._sides[axis], self._axes[coordinate][axis]
        count = _POINTS * spans
        first, values, slopes, curvatures = _quadratic((np.arange(count) + 0.5) / count, spans)
        here = first[:, None] + np.arange(3)
        means = []
        for each in (values, slopes / side, curvatures / side**2):
            rows = np.zeros((count, known.size))
            np.add.at(rows, (np.arange(count)[:, None], known.number[here]), each * known.sign[here])
            means.append(rows.T @ rows / count)
        return means


def _quadratic(at: Floats, spans: int) -> tuple[Index, Floats, Floats, Floats]:
    """Return the first of the three splines at points from 0 to 1; values, first and second derivatives (P, 3)."""
    scaled = np.clip(at, 0, 1) * spans
    first = np.minimum(scaled.astype(np.int64), spans - 1)
    u = scaled - first
    values = np.stack([0.5 * (1 - u) ** 2, 0.5 + u - u * u, 0.5 * u * u], 1)
    slopes = np.stack([u - 1, 1 - 2 * u, u], 1) * spans
    return first, values, slopes, np.tile([1.0, -2, 1], (len(u), 1)) * spans**2
