"""Mend a fitted surface: no face folded, few faces newly cutting others, and as near the fit as was found.

1. A base without faults: of the steps of a smooth map of space that can be undone (`invertible.py`), the last, which is
   nearest to the fit, that is mended by few regions (`regions.py`); else an affine map of the whole; else the surface
   at rest, which is never broken.
2. From there everything moves on to the fit, on straight lines and by shares of the way that remains: small ones first,
   so that what would go through something else stops before it, then all of it, then what was held up. Places where a
   step would break something stay for it, with more around them each time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from meshdeform.exemplar.faults import Faults, Found
from meshdeform.exemplar.invertible import affine_map, invertible_stages
from meshdeform.exemplar.measures import kept_share
from meshdeform.exemplar.regions import Surroundings, mended_by_regions
from meshdeform.nouns.labels import Floats, Index
from meshdeform.support.giving_way import give_way

__all__ = ["Mended", "mended"]

_STEPS = (*3 * (0.2,), 1.0, *4 * (0.3,))
_TRIES = 14
_RADIUS, _GROWTH = 0.004, 1.4
_TOWARD_REST = (0.0, 0.5, 0.75, 0.9)
"""A map that stretches much in one direction may fold the surface at a crease."""
_SEARCHED, _SEARCHED_OF_FACE = 5_000_000, 10
"""Faces that are searched, and more for each face; half of them for the base."""


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


def mended(rest: Floats, goal: Floats, faces: Index) -> Mended:
    """Return a surface near the goal without folds, in which few faces newly cut others (`faults.MOST_CUTTING`).

    Parameters
    ----------
    rest, goal : (V, 3) float64
        Vertices before and after a fit.
    faces : (F, 3) int64
    """
    faults = Faults(rest, faces)
    found = faults.find(goal)
    if not found.is_clean:
        found = _Mending(rest, goal, faults, Surroundings(rest, faces)).result()
    kept = kept_share(rest, goal, found.verts, faces)
    return Mended(found.verts, kept, int(found.folded.sum()), int(found.cutting.sum()))


class _Mending:
    """The mending of one surface with faults."""

    def __init__(self, rest: Floats, goal: Floats, faults: Faults, around: Surroundings) -> None:
        self._rest, self._goal, self._faults, self._around = rest, goal, faults, around
        self._most = faults.searched + _SEARCHED + _SEARCHED_OF_FACE * len(around.faces)

    def result(self) -> Found:
        """Return the mended surface: in the worst case as it is at rest."""
        for base in self._bases():
            start = self._faults.find(base)
            found = mended_by_regions(start, self._faults, self._around)
            if found is not None:
                return self._moved_on(found)
        return self._faults.find(self._rest)

    def _bases(self) -> Iterator[Floats]:
        """Yield shapes (V, 3) that are hardly broken, the nearest to the goal first; the last is at rest."""
        affine = affine_map(self._rest, self._goal, self._around.masses)
        start = self._rest @ affine[:3] + affine[3]
        for stage in reversed(invertible_stages(self._rest, self._goal, self._around.faces, start)):
            if 2 * self._faults.searched < self._most:
                yield stage
        for share in _TOWARD_REST:
            yield start + share * (self._rest - start)
        yield self._rest

    def _moved_on(self, base: Found) -> Found:
        """Return a shape without faults moved on toward the goal as far as nothing breaks."""
        way = self._goal - base.verts
        gone, best, last = np.zeros(len(way)), base, base
        for step in _STEPS:
            free, hits = np.ones(len(way)), np.zeros(len(way), np.int64)
            for _ in range(_TRIES):
                give_way()
                tried = gone + step * (1 - gone) * free
                if self._faults.searched > self._most:
                    return best
                last = self._faults.find(base.verts + tried[:, None] * way, last)
                if last.is_clean:
                    gone, best = tried, last
                    break
                seeds = self._around.corners(last.to_mend)
                number = hits[seeds] + 1
                for times in np.unique(number):
                    rows, weights = self._around.weights(seeds[number == times], _RADIUS * _GROWTH ** (times - 1))
                    free[rows] *= 1 - weights
                    hits[rows] = np.maximum(hits[rows], times)
        return best
