"""Give one shape the outline of another, slab by slab from its foot to its top.

In a slab of 1/32 of the height, a coordinate x of the points has the middle c and the half width X of its 2.5th and
97.5th percentiles; both are smoothed over the height that edges span, three slabs at least, so that coarse faces keep
together. With the height y' = g(y) of a rising function a point goes to

    (c_goal + (x - c) X_goal / X,  g(y),  likewise z),      ratios in 0.12 to 8,

where the goal's are taken at g(y). Slabs without points take what lies between their neighbours. Such a map turns
nothing over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from meshdeform.nouns.labels import Floats

__all__ = ["outlined"]

_SLABS, _PERCENTILES = 32, (2.5, 97.5)
_RATIOS = (0.12, 8.0)
_LEAST = 0.004
_SPAN, _LEAST_SPAN = 0.4, 0.7
"""Standard deviation of the smoothing: a share of the height that edges span, and the least, in slabs."""


@dataclass(frozen=True)
class _Outline:
    """Heights (S,) of slabs, and the middles and half widths (S, 2) in x and z."""

    heights: Floats
    middles: Floats
    widths: Floats


def outlined(
    verts: Floats, positions: Floats, goal_positions: Floats, height: Callable[[Floats], Floats], span: float
) -> Floats:
    """Return vertices (V, 3) with the outline of a goal.

    `positions` and `goal_positions` (N, 3): samples of both; `height` takes heights (N,) of the source to the goal's;
    `span`: the height that edges of the source span, in the mean.
    """
    edges = np.linspace(positions[:, 1].min(), positions[:, 1].max(), _SLABS + 1)
    slabs = span / max(float(edges[1] - edges[0]), 1e-9)
    own, goal = _outline(positions, edges, slabs), _outline(goal_positions, height(edges), slabs)
    moved = verts.copy()
    moved[:, 1] = height(verts[:, 1])
    for column, axis in enumerate((0, 2)):
        ratio = np.clip(goal.widths[:, column] / own.widths[:, column], *_RATIOS)
        at = verts[:, 1]
        middle, to = (np.interp(at, own.heights, one.middles[:, column]) for one in (own, goal))
        moved[:, axis] = to + (verts[:, axis] - middle) * np.interp(at, own.heights, ratio)
    return moved


def _outline(positions: Floats, edges: Floats, span: float) -> _Outline:
    """Return the outline of points between the edges (S + 1,) of slabs, smoothed over a span of so many slabs."""
    slab = np.searchsorted(edges, positions[:, 1], side="right") - 1
    slab[positions[:, 1] >= edges[-1]] = len(edges) - 2
    ends = np.full((len(edges) - 1, 2, 2), np.nan)
    for number in range(len(ends)):
        own = positions[slab == number][:, [0, 2]]
        if len(own):
            ends[number] = np.percentile(own, _PERCENTILES, axis=0)
    known = np.flatnonzero(np.isfinite(ends[:, 0, 0]))
    flat = ends.reshape(len(ends), 4)
    flat = np.stack([np.interp(np.arange(len(flat)), known, flat[known, column]) for column in range(4)], 1)
    flat = gaussian_filter1d(flat, max(_SPAN * span, _LEAST_SPAN), axis=0, mode="nearest")
    low, high = flat[:, :2], flat[:, 2:]
    return _Outline((edges[:-1] + edges[1:]) / 2, (low + high) / 2, np.maximum((high - low) / 2, _LEAST))
