"""Mend a fitted surface: no face folded, few faces newly cutting others, and as near the fit as was found.

1. A base without faults: of the steps of a smooth map of space that can be undone (`invertible.py`), the last, which is
   nearest to the fit, that is mended by few regions (`regions.py`); else an affine map of the whole, which never breaks
   anything.
2. From there everything moves on to the fit, on straight lines. Places where this would break something stay, with more
   around them each time; then they, too, move on by shares of their way that remain, as far as nothing breaks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshdeform.exemplar.faults import Faults, Found
from meshdeform.exemplar.invertible import affine_map, invertible_stages
from meshdeform.exemplar.measures import kept_share, vertex_areas
from meshdeform.exemplar.regions import Surroundings, mended_by_regions
from meshdeform.nouns.labels import Floats, Index

__all__ = ["Mended", "mended"]

_SHARE = 0.009
_STEPS = (1.0, *6 * (0.25,))
_TRIES = 14
_RADIUS, _GROWTH = 0.007, 1.5
_TOWARD_REST = (0.0, 0.5, 0.75, 0.9)
"""A map that stretches much in one direction may fold the surface at a crease."""


@dataclass(frozen=True)
class Mended:
    """A mended surface.

    `verts` (V, 3) float64; `kept`: the share of the displacement to the goal that was left, by area; `flipped` and
    `cut`: faces that are folded, and that newly cut others.
    """

    verts: Floats
    kept: float
    flipped: int
    cut: int


def mended(rest: Floats, goal: Floats, faces: Index, *, share: float = _SHARE) -> Mended:
    """Return a surface near the goal without folds, in which at most a share of the faces newly cuts others.

    Parameters
    ----------
    rest, goal : (V, 3) float64
        Vertices before and after a fit.
    faces : (F, 3) int64
    share : float
        Of the faces.
    """
    faults = Faults(rest, faces)
    found = faults.find(goal)
    if not found.clean(share):
        around = Surroundings(rest, faces)
        base = _base(rest, goal, vertex_areas(rest, faces), faults, around, share)
        found = _moved_on(base, goal, faults, around, share)
    kept = kept_share(rest, goal, found.verts, faces)
    return Mended(found.verts, kept, int(found.folded.sum()), int(found.cutting.sum()))


def _base(rest: Floats, goal: Floats, masses: Floats, faults: Faults, around: Surroundings, share: float) -> Found:
    """Return a shape without faults near the goal."""
    affine = affine_map(rest, goal, masses)
    start = rest @ affine[:3] + affine[3]
    for stage in reversed(invertible_stages(rest, goal, around.faces, start)):
        base = mended_by_regions(faults.find(stage), faults, around, masses, share)
        if base is not None:
            return base
    for part in _TOWARD_REST:
        found = faults.find(start + part * (rest - start))
        if found.clean(share):
            return found
    return faults.find(rest)


def _moved_on(base: Found, goal: Floats, faults: Faults, around: Surroundings, share: float) -> Found:
    """Return a shape without faults moved on toward the goal as far as nothing breaks."""
    way = goal - base.verts
    gone, best, last = np.zeros(len(goal)), base, base
    for step in _STEPS:
        free, hits = np.ones(len(goal)), np.zeros(len(goal), np.int64)
        for _ in range(_TRIES):
            tried = gone + step * (1 - gone) * free
            last = faults.find(base.verts + tried[:, None] * way, last)
            if last.clean(share):
                gone, best = tried, last
                break
            seeds = around.corners(last.to_mend(share))
            number = hits[seeds] + 1
            for times in np.unique(number):
                rows, weights = around.weights(seeds[number == times], _RADIUS * _GROWTH ** (times - 1))
                free[rows] *= 1 - weights
                hits[rows] = np.maximum(hits[rows], times)
    return best
