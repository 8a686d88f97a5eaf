"""Place a part of a member: scaled along the axes, then moved smoothly so that the places where it is joined go along.

A joint j is a ball of radius r_j around c_j, all of which moves by w_j. Other points of its piece of surface move by

    u(x) = sum_j w_j / d_j(x)^2 / sum_j 1 / d_j(x)^2,    d_j(x) = max(|x - c_j| - r_j, small).

Where a joint alone leaves a place off its neighbour, since the two are not of one form, a seam bends the surface to it:
each of the places p_j goes its own way r_j, evened over a distance s, and what is nearer than R to one goes along,

    v(x) = (1 - (d(x) / R)^2)^2 sum_j r_j / (|x - p_j|^2 + s^2) / sum_j 1 / (|x - p_j|^2 + s^2),  d(x) = min |x - p_j|.

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
_EVEN = 0.004
"""Distance, in diagonals, over which the ways of a seam are evened out."""


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
class PartSeam:
    """Places of a part that go their own ways, after its joints, and what is near them along with them."""

    points: _Floats  # (P, 3) float64
    ways: _Floats  # (P, 3) float64
    patch: int
    reach: float

    def moved(self, points: _Floats) -> _Floats:
        """Return the displacement (Q, 3) of points on the seam's patch."""
        ways = np.zeros_like(points)
        low, high = self.points.min(0) - self.reach, self.points.max(0) + self.reach
        rows = np.flatnonzero(((points > low) & (points < high)).all(1))
        apart = np.linalg.norm(points[rows, None] - self.points, axis=2)
        nearest = apart.min(1, initial=np.inf)
        near = nearest < self.reach
        rows, weights = rows[near], 1 / (apart[near] ** 2 + _EVEN**2)
        fading = (1 - (nearest[near, None] / self.reach) ** 2) ** 2
        ways[rows] = fading * (weights @ self.ways) / weights.sum(1, keepdims=True)
        return ways


@dataclass(frozen=True)
class PartFloor:
    """A plane beside which a part ends: what is deeper, and no farther aside than `reach` from a place, goes up to it.

    Nothing goes farther than `most`, which what is far deeper goes as a whole; half as far aside again, the way fades.
    """

    place: _Floats  # (3,) float64
    normal: _Floats  # (3,) float64: unit, away from what is not to be entered
    reach: float
    most: float
    patch: int

    def moved(self, points: _Floats) -> _Floats:
        """Return the displacement (Q, 3) of points on the floor's patch."""
        away = points - self.place
        height = away @ self.normal
        aside = np.linalg.norm(away - height[:, None] * self.normal, axis=1)
        share = np.clip(3 - 2 * aside / max(self.reach, _INSIDE), 0.0, 1.0)
        return np.asarray((share * np.clip(-height, 0.0, self.most))[:, None] * self.normal)


@dataclass(frozen=True)
class Placing:
    """Where a part goes: `scale` (3,) and `shift` (3,) of the rough fit, then its joints, seams and floors."""

    scale: _Floats
    shift: _Floats
    joints: list[PartJoint] = field(default_factory=list)
    seams: list[PartSeam | PartFloor] = field(default_factory=list)

    def roughly(self, points: _Floats) -> _Floats:
        """Return points (P, 3) of the member after the rough fit."""
        return points + ((self.scale - 1) * points + self.shift)

    def moved(self, points: _Floats, patches: _Index) -> _Floats:
        """Return the displacement (P, 3) of points of the member; `patches` (P,) are theirs."""
        way = (self.scale - 1) * points + self.shift
        if self.joints:
            way = way + self._joined(points + way, patches)
        for seam in self.seams:
            rows = patches == seam.patch
            if rows.any():
                way[rows] += seam.moved(points[rows] + way[rows])
        return way

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
