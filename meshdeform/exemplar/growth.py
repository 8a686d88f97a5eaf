"""Let parts of a surface grow that smooth maps cannot give it: ears, noses, horns, fins, tails.

What the surface lacks sprouts from a patch of its own (`sprouts`); what it has, but must grow much, starts as it is.
Then these parts and those that touch them are fitted to their like by a smooth displacement of their vertices
(`surface_fit`); what is to grow counts 3.3 times as much as the others. All else stays where it is.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from meshdeform.exemplar.smooth_fit import CodedSurface
from meshdeform.exemplar.sprouts import GoalPart, Ground, limb_of, seat_of, sprouted
from meshdeform.exemplar.surface_fit import FitSchedule, SurfaceGoal, surface_fit
from meshdeform.geometry.mesh import face_areas
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.samples import hidden, spread

__all__ = ["grown"]

_MANNER = FitSchedule(samples=3000, rounds=8, stiffness=(3.0, 0.1), limits=(0.2, 0.04), sliding=(1.0, 0.1), held=0.02)
_LIMB_SAMPLES = 6000
_OTHERS = 0.3


def grown(
    surface: CodedSurface,
    goal: CodedSurface,
    *,
    parents: Mapping[int, int],
    much: Collection[int] = (),
    before: Floats | None = None,
) -> Floats:
    """Return the vertices (V, 3) of a surface whose parts have grown as those of its goal.

    Parameters
    ----------
    surface, goal : CodedSurface
        The surface, fitted to the goal but for what is to grow, with the part of each face; like parts have equal
        numbers.
    parents : mapping of int to int
        Each part that only the goal has and that is to sprout, with the part of the surface on which it does.
    much : collection of int
        Parts of both that must grow much.
    before : array (V, 3) float64, optional
        The surface before its last fit, of which what stuck out may have been flattened.
    """
    verts, faces, codes = surface
    seen = _Goal(goal)
    limbs = {code: limb for code in sorted(parents) if (limb := seen.limb(code)) is not None}
    ground = Ground.of(verts, faces)
    start, codes = _sprout(
        ground, ground if before is None else Ground.of(before, faces), faces, codes, seen, limbs, parents
    )
    growing = set(much) | set(limbs)
    growing &= set(codes.tolist()) & set(goal.codes.tolist())
    if not growing:
        return verts.copy()
    fitted = growing | _touching_parts(faces, codes, growing, len(verts))
    codes = np.where(np.isin(codes, list(fitted)), codes, -1)
    return surface_fit(verts, faces, codes, seen.of(fitted, growing), _MANNER, start=start)


class _Goal:
    """What is seen of the goal: samples with their parts."""

    def __init__(self, surface: CodedSurface) -> None:
        verts, faces, codes = surface
        samples = spread(verts, faces, _LIMB_SAMPLES, 4)
        self._all, self._codes = samples, codes[samples.faces]
        self._inside = hidden(samples, self._codes)
        self.samples, self.codes = samples.rows(~self._inside), self._codes[~self._inside]
        self.area = float(face_areas(verts, faces).sum()) / _LIMB_SAMPLES
        """Of the surface that each sample stands for."""

    def limb(self, code: int) -> GoalPart | None:
        """Return what is seen of a part."""
        return limb_of(self._all, self._codes == code, self._inside, self.area)

    def seen(self, code: int) -> float:
        """Return the area that is seen of a part."""
        return float((self.codes == code).sum()) * self.area

    def of(self, fitted: Collection[int], growing: Collection[int]) -> SurfaceGoal:
        """Return the samples of the parts that are fitted."""
        rows = np.isin(self.codes, list(fitted))
        counts = np.where(np.isin(self.codes[rows], list(growing)), 1.0, _OTHERS) / len(self.codes)
        return SurfaceGoal(self.samples.rows(rows), self.codes[rows], counts)


def _sprout(
    ground: Ground,
    before: Ground,
    faces: Index,
    codes: Index,
    goal: _Goal,
    limbs: Mapping[int, GoalPart],
    parents: Mapping[int, int],
) -> tuple[Floats, Index]:
    """Return where the vertices start, and the codes of the faces with those of the patches."""
    start, patched = ground.verts.copy(), codes.copy()
    verts_of_parents = {code: np.unique(faces[codes == parents[code]]) for code in limbs}
    found = {code: seat_of(limb, ground, before, verts_of_parents[code]) for code, limb in limbs.items()}
    seats = {code: seat for code, seat in found.items() if seat is not None}
    for code, seat in seats.items():
        limb = limbs[code]
        siblings = [limbs[other] for other in seats if parents[other] == parents[code]]
        whole = goal.seen(parents[code]) + sum(other.area for other in siblings)
        rivals = before.verts[[other.middle for key, other in seats.items() if key != code]]
        sprout = sprouted(limb, seat, before, verts_of_parents[code], limb.area / whole, rivals)
        start[sprout.verts] = sprout.start
        patch = np.zeros(len(start), bool)
        patch[sprout.verts] = True
        patched[patch[faces].sum(1) >= 2] = code
    return start, patched


def _touching_parts(faces: Index, codes: Index, growing: Collection[int], count: int) -> set[int]:
    """Return the parts that touch those that grow."""
    near = np.zeros(count, bool)
    near[faces[np.isin(codes, list(growing))]] = True
    return set(codes[near[faces].any(1)].tolist()) - set(growing)
