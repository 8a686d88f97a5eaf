"""Place a part of a member: scaled along the axes, then moved smoothly so that the places where it is joined go along.

A joint j is a ball of radius r_j around c_j, all of which moves by w_j. Other points of its piece of surface move by

    u(x) = sum_j w_j / d_j(x)^2 / sum_j 1 / d_j(x)^2,    d_j(x) = max(|x - c_j| - r_j, small).

Source: Shepard 1968, A two-dimensional interpolation function for irregularly-spaced data.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_FLAT = 0.03**2
"""Variance, in squared diagonals, below which an extent says little about a scale: the scale is drawn to 1."""
_LEAST, _MOST = 0.2, 5.0
_INSIDE, _STEP = 1e-4, 1e-5


def axis_fit(source: _Floats, target: _Floats) -> tuple[_Floats, _Floats]:
    """Return the scales (3,) along x, y and z and the shift (3,) that take points (P, 3) best to others.

    Equal points give exactly ones and zeros.
    """
    a, b = source.mean(0), target.mean(0)
    covariance, variance = ((source - a) * (target - b)).mean(0), ((source - a) ** 2).mean(0)
    scale = np.clip((covariance + _FLAT) / (variance + _FLAT), _LEAST, _MOST)
    return scale, b - scale * a


@dataclass
class PartJoint:
    """A place of a part that goes where it meets a neighbour, after the rough fit."""

    centre: _Floats  # (3,) float64
    radius: float
    patch: int  # the connected patch of the part
    way: _Floats = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Placing:
    """Where a part goes: `scale` (3,) and `shift` (3,) of the rough fit, then its joints."""

    scale: _Floats
    shift: _Floats
    joints: list[PartJoint] = field(default_factory=list)

    def roughly(self, points: _Floats) -> _Floats:
        """Return points (P, 3) of the member after the rough fit."""
        return points + ((self.scale - 1) * points + self.shift)

    def moved(self, points: _Floats, patches: _Index) -> _Floats:
        """Return the displacement (P, 3) of points of the member; `patches` (P,) are theirs."""
        rough = (self.scale - 1) * points + self.shift
        return rough + self._joined(points + rough, patches) if self.joints else rough

    def linear(self, points: _Floats, patches: _Index) -> _Floats:
        """Return the linear map (P, 3, 3) at the points."""
        here = self.moved(points, patches)
        columns = [(self.moved(points + _STEP * axis, patches) - here) / _STEP for axis in np.eye(3)]
        return np.eye(3) + np.stack(columns, 2)

    def _joined(self, points: _Floats, patches: _Index) -> _Floats:
        """Return how far the joints move points (P, 3); a patch without a joint follows all."""
        ways = np.zeros_like(points)
        for patch in np.unique(patches):
            rows = patches == patch
            joints = [each for each in self.joints if each.patch == patch] or self.joints
            total, weights = np.zeros((int(rows.sum()), 3)), np.zeros((int(rows.sum()), 1))
            for each in joints:
                away = np.linalg.norm(points[rows] - each.centre, axis=1, keepdims=True) - each.radius
                share = 1 / np.maximum(away, _INSIDE) ** 2
                total += share * each.way
                weights += share
            ways[rows] = total / weights
        return ways
