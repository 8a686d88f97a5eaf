"""Mend a fitted surface: no face folded, few faces newly cutting others, and as near the fit as was found.

The stages between the surface at rest and its fit y are an affine map of the whole, which neither folds nor cuts, then
the steps of a smooth map of space that can be undone (`invertible.py`), which hardly do, and y. A vertex is at progress
t, a real number of stages, on the line between two of them.

1. Back: all begin at y. Around faulty faces the progress falls, the more and the farther the more often a place was
   found faulty, to the affine map in the end. This always ends without faults.
2. On: from there all move toward y again on straight lines, step by step; places where a step would break something
   stay, with more around them each time.

A neighbourhood of radius r is weighed by smoothstep(2 - d / r) of the distance d at rest to the faulty vertices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.exemplar.faults import Faults, Found
from meshdeform.exemplar.invertible import affine_map, invertible_stages
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["Mended", "mended"]

_SHARE = 0.009
_RADIUS, _GROWTH = 0.0135, 1.35
"""Of the diagonal, and what each further time multiplies it by."""
_DOWN, _DOWN_GROWTH, _MOST_DOWN = 0.25, 1.25, 4.0
_ROUNDS = 60
_STEPS, _MOST_STEPS, _TRIES, _LEAST_STEP = 6, 12, 4, 0.02
_HELD = 0.01
_HOLD_RADIUS, _HOLD_GROWTH = 0.015, 1.5
_TOWARD_REST = (0.0, 0.5, 0.75, 0.9)


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
    if found.clean(share):
        return _of(rest, goal, goal, faces, faults, found)
    surroundings = _Surroundings(rest, faces)
    back = _taken_back(rest, goal, faces, faults, surroundings, share)
    verts, found = _moved_on(back, goal, faults, surroundings, share)
    return _of(rest, goal, verts, faces, faults, found)


def _of(rest: Floats, goal: Floats, verts: Floats, faces: Index, faults: Faults, found: Found) -> Mended:
    masses = _masses(faces, faults.areas, len(rest))
    whole = float(masses @ np.linalg.norm(goal - rest, axis=1))
    lost = float(masses @ np.linalg.norm(goal - verts, axis=1))
    return Mended(verts, 1 - lost / whole if whole > 0 else 1.0, int(found.folded.sum()), int(found.cutting.sum()))


def _masses(faces: Index, areas: Floats, count: int) -> Floats:
    """Return the area (V,) around each vertex, and a little more than nothing of those without any."""
    masses = np.bincount(faces.ravel(), np.repeat(areas / 3, 3), count)
    return np.asarray(masses + 1e-9 * masses.max(initial=0.0) + 1e-300)


class _Surroundings:
    """What lies around vertices of a surface at rest (V, 3)."""

    def __init__(self, rest: Floats, faces: Index) -> None:
        self._rest, self._faces = rest, faces
        used = rest[np.unique(faces)]
        self._diagonal = float(np.linalg.norm(np.ptp(used, axis=0)))

    def seeds(self, bad: Flags) -> Index:
        """Return the vertices of faces (F,)."""
        return np.unique(self._faces[bad])

    def weights(self, seeds: Index, radius: float) -> Floats:
        """Return weights (V,): 1 within a radius, a share of the diagonal, of the seeds, 0 from twice of it."""
        radius = min(radius, 2.0) * self._diagonal
        distances = cKDTree(self._rest[seeds]).query(self._rest, distance_upper_bound=2 * radius)[0]
        share = np.clip(2 - distances / max(radius, 1e-300), 0, 1)
        return np.asarray(share**2 * (3 - 2 * share))


def _taken_back(
    rest: Floats, goal: Floats, faces: Index, faults: Faults, surroundings: _Surroundings, share: float
) -> Floats:
    """Return a surface without faults: the goal, taken back around what is faulty."""
    masses = _masses(faces, faults.areas, len(rest))
    start = _whole_map(rest, goal, masses, faults, share)
    stages = np.stack([start, *invertible_stages(rest, goal, masses, start), goal])
    progress = np.full(len(rest), len(stages) - 1.0)
    hits = np.zeros(len(rest), np.int64)
    for _ in range(_ROUNDS):
        verts = _at(stages, progress)
        found = faults.find(verts)
        if found.clean(share):
            return verts
        seeds = surroundings.seeds(found.to_mend(share))
        hits[seeds] += 1
        down = np.zeros(len(rest))
        for number in np.unique(hits[seeds]):
            weights = surroundings.weights(seeds[hits[seeds] == number], _RADIUS * _GROWTH ** (number - 1))
            down = np.maximum(down, weights * min(_DOWN * _DOWN_GROWTH ** (number - 1), _MOST_DOWN))
        progress = np.maximum(progress - down, 0)
    return start


def _at(stages: Floats, progress: Floats) -> Floats:
    """Return where vertices (V, 3) lie at a progress (V,) through stages (S, V, 3)."""
    low = np.minimum(progress.astype(np.int64), len(stages) - 2)
    share, rows = (progress - low)[:, None], np.arange(len(progress))
    return np.asarray((1 - share) * stages[low, rows] + share * stages[low + 1, rows])


def _whole_map(rest: Floats, goal: Floats, masses: Floats, faults: Faults, share: float) -> Floats:
    """Return the surface moved by one affine map near the goal that breaks nothing; where each does, at rest."""
    fitted = np.concatenate([rest, np.ones((len(rest), 1))], axis=1) @ affine_map(rest, goal, masses)
    for part in _TOWARD_REST:
        verts = fitted + part * (rest - fitted)
        if faults.find(verts).clean(share):
            return verts
    return rest


def _moved_on(
    verts: Floats, goal: Floats, faults: Faults, surroundings: _Surroundings, share: float
) -> tuple[Floats, Found]:
    """Return vertices without faults moved on toward the goal as far as nothing breaks."""
    way = goal - verts
    gone, free, hits = np.zeros(len(verts)), np.ones(len(verts)), np.zeros(len(verts), np.int64)
    best, step = faults.find(verts), 1 / _STEPS
    for _ in range(_MOST_STEPS):
        if step < _LEAST_STEP or not ((gone < 1) & (free > _HELD)).any():
            break
        for _ in range(_TRIES):
            tried = np.minimum(gone + step * free, 1)
            found = faults.find(verts + tried[:, None] * way)
            if found.clean(share):
                gone, best = tried, found
                break
            seeds = surroundings.seeds(found.to_mend(share))
            hits[seeds] += 1
            for number in np.unique(hits[seeds]):
                radius = _HOLD_RADIUS * _HOLD_GROWTH ** (number - 1)
                free *= 1 - surroundings.weights(seeds[hits[seeds] == number], radius)
        else:
            step /= 2
    return verts + gone[:, None] * way, best
