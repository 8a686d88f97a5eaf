"""Find parts of a signed distance grid that are thinner than its cells can tell. numpy only."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_CELLS = 192
"""Most cells along the longest side of the grid from which a first mesh is made."""
_DEPTH = 1.25
"""A place is thin if nothing around it is deeper, and it is less deep than this many cells: a tube of four cells
across always has a value deeper than that, wherever the grid lies."""
_SHARE = 0.01
"""Thin places per value just inside the surface from which on they are no noise."""


def coarsening(shape: tuple[int, ...]) -> int:
    """Return how many values apart are those from which a first mesh is made."""
    return max(1, math.ceil(max(shape) / _CELLS))


def thin_warnings(values: _Floats, spacing: _Floats) -> tuple[str, ...]:
    """Return a sentence about parts of a grid (X, Y, Z) that are too thin for its cells, if there are any.

    Along the middle of a thin wall or tube no neighbour is deeper, and the depth is half of what is there. Where a
    surface only bends, there is a deeper neighbour.
    """
    step = coarsening(values.shape)
    values, cell = values[::step, ::step, ::step], float(spacing.max()) * step
    inside = np.argwhere(values < 0)
    inside = inside[((inside > 0) & (inside < np.array(values.shape) - 1)).all(1)]
    own = values[tuple(inside.T)]
    around = [d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)]
    outer, flat = np.zeros(len(inside), np.bool_), own <= 0.999 * values.min()
    for d in around:
        there = values[tuple((inside + d).T)]
        flat &= there == own
        if sum(map(abs, d)) == 1:
            outer |= there >= 0
    # The constant beyond the band of a level set says nothing about how deep it is there.
    low = 0.999 * values.min() if flat.any() else -np.inf
    thin = own > max(low, -_DEPTH * cell)
    for d in around:
        rows = np.flatnonzero(thin)
        thin[rows] = values[tuple((inside[rows] + d).T)] >= own[rows] - 1e-6 * cell
    if thin.sum() <= _SHARE * outer.sum():
        return ()
    across = 2 * float(np.median(-own[thin])) / cell
    words = f"Parts of the surface are only about {across:.1f} cells thick and may come out torn; four are needed."
    if step == 1:
        return (f"{words} Send a finer grid.",)
    return (f"{words} A cell here is {step} of the grid's, which has more than {_CELLS}. Send a mesh, or points.",)
