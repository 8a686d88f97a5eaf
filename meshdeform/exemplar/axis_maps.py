"""Move along each axis by itself, so that what is level, upright or straight along an axis stays so and nothing folds.

A point x goes to (f_1(x_1), f_2(x_2), f_3(x_3)), each f rising and linear between 17 even knots. Its slopes s_k are the
least squares of

    sum w (f(x) - y)^2 / sum w  +  0.002 mean (s_k - s_(k+1))^2,      0.1 <= s_k <= 6,

over given points x, their goals y and weights w. Such a map neither folds nor cuts, and keeps together what touches.

Source: Lawson and Hanson 1974, Solving least squares problems (bounds).
"""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.labels import Floats

__all__ = ["AxisMaps", "axis_maps"]

_KNOTS = 17
_SLOPES = (0.1, 6.0)
_EVEN = 0.002


class AxisMaps:
    """Rising functions of each coordinate: `knots` and `values` (3, K)."""

    def __init__(self, knots: Floats, values: Floats) -> None:
        self.knots, self.values = knots, values

    def map_points(self, points: Floats) -> Floats:
        """Return the mapped points (N, 3) float64."""
        return np.stack([self.along(axis, points[:, axis]) for axis in range(3)], 1)

    def along(self, axis: int, at: Floats) -> Floats:
        """Return where coordinates (N,) on one axis go; beyond the ends the map goes on as its last piece."""
        knots, values = self.knots[axis], self.values[axis]
        slopes = np.diff(values) / np.diff(knots)
        beyond = np.minimum(at - knots[0], 0) * slopes[0] + np.maximum(at - knots[-1], 0) * slopes[-1]
        return np.asarray(np.interp(at, knots, values) + beyond)


def axis_maps(positions: Floats, goals: Floats, weights: Floats, *, mirrored: bool) -> AxisMaps:
    """Return the maps that take points (N, 3) nearest to their goals; `mirrored`: that of x is odd."""
    knots, values = np.empty((3, _KNOTS)), np.empty((3, _KNOTS))
    for axis in range(3):
        x, y, w = positions[:, axis], goals[:, axis], weights
        if mirrored and axis == 0:
            x, y, w = np.concatenate([x, -x]), np.concatenate([y, -y]), np.concatenate([w, w])
        low, high = float(x.min()), float(x.max())
        knots[axis] = np.linspace(low, max(high, low + 1e-6), _KNOTS)
        values[axis] = _fitted(knots[axis], x, y, w / w.sum())
    return AxisMaps(knots, values)


def _fitted(knots: Floats, x: Floats, y: Floats, weights: Floats) -> Floats:
    """Return the values (K,) at the knots of one rising function."""
    from scipy.optimize import lsq_linear  # takes long to import, and few are fitted so

    steps = np.diff(knots)
    passed = np.clip(x[:, None] - knots[None, :-1], 0, steps)  # how much of each interval lies below
    root = np.sqrt(weights)[:, None]
    rows = np.concatenate([root * np.column_stack([np.ones(len(x)), passed]), _evenness(len(steps))])
    right = np.concatenate([root[:, 0] * y, np.zeros(len(steps) - 1)])
    low = np.concatenate([[-np.inf], np.full(len(steps), _SLOPES[0])])
    high = np.concatenate([[np.inf], np.full(len(steps), _SLOPES[1])])
    upper = np.asarray(np.linalg.qr(np.column_stack([rows, right]), mode="r"))
    found = lsq_linear(upper[:-1, :-1], upper[:-1, -1], (low, high), method="bvls").x
    return np.asarray(found[0] + np.concatenate([[0.0], np.cumsum(found[1:] * steps)]))


def _evenness(count: int) -> Floats:
    """Return the rows of the differences of neighbouring slopes."""
    rows = np.zeros((count - 1, count + 1))
    at = np.arange(count - 1)
    rows[at, at + 1], rows[at, at + 2] = 1, -1
    return np.asarray(rows * np.sqrt(_EVEN / (count - 1)))
