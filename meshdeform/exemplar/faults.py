"""Find what is broken in a deformed surface: faces newly folded, and faces that newly cut others.

Both are counted as a run's report does (`geometry/quality.py`): a fold is a face that points against its neighbours and
did not at rest; a pair of faces cuts newly if at rest it neither cut nor touched.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.folds import FaceNeighbours, area_vectors, longest_squared, without_rounding
from meshdeform.geometry.intersections import (
    TooManyPairsError,
    cutting_pairs,
    faces_near,
    intersecting_faces,
    touching_at_rest,
)
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["MOST_CUTTING", "Faults", "Found"]

MOST_CUTTING = 0.003
"""Share of the faces, by number and by area, that may newly cut others: a cut of large faces is seen."""
_LOCAL = 0.5
"""Share of changed faces from which the whole surface is searched again."""
_GIVEN_UP = 10
_KNOWN = 200_000
"""Pairs of which it is known whether they touch at rest: shapes on one way have mostly the same."""
_NO_PAIRS = np.zeros((0, 2), np.int64)


@dataclass(frozen=True)
class Found:
    """What is broken in a shape.

    `verts` (V, 3) float64: the shape; `folded` (F,): its folded faces; `pairs` (P, 2) int64: those that newly cut each
    other, ascending; `crowded`: so many meet that they were not listed; `areas` (F,) float64: of the faces at rest.
    """

    verts: Floats
    folded: Flags
    pairs: Index
    areas: Floats
    crowded: bool = False

    @cached_property
    def cutting(self) -> Flags:
        """Which faces (F,) newly cut another one."""
        flags = np.full(len(self.folded), self.crowded)
        flags[self.pairs.ravel()] = True
        return flags

    @cached_property
    def is_clean(self) -> bool:
        """Whether nothing is folded, and few faces cut."""
        return not self.folded.any() and not self.too_many_cut

    @cached_property
    def too_many_cut(self) -> bool:
        """Whether more than `MOST_CUTTING` of the faces, or of the area, cuts."""
        area = float(self.areas[self.cutting].sum())
        count = int(self.cutting.sum())
        return count > MOST_CUTTING * len(self.folded) or area > MOST_CUTTING * float(self.areas.sum())

    @property
    def to_mend(self) -> Flags:
        """Which faces (F,) have to change: the folded ones, and if too many cut, those."""
        return self.folded | self.cutting if self.too_many_cut else self.folded


class Faults:
    """Finds the faults of shapes of the same faces (F, 3), whose vertices (V, 3) float64 lie at `rest` at first.

    Where so many faces lie on or in each other at rest that their pairs cannot be searched, no cuts are found.

    Attributes
    ----------
    searched : int
        Faces among which pairs were searched so far, in all; a search that was given up counts tenfold.
    """

    def __init__(self, rest: Floats, faces: Index) -> None:
        self._rest, self._faces = np.ascontiguousarray(rest), np.ascontiguousarray(faces, np.int64)
        self._areas: Floats = np.linalg.norm(area_vectors(self._rest, self._faces), axis=1) / 2
        self._solid = np.flatnonzero(self._areas > COLLAPSED_SHAPE * longest_squared(self._rest, self._faces))
        self.searched = 0
        self._seen = self._touching_at_rest = np.zeros(0, np.int64)
        self._neighbours = FaceNeighbours(self._faces[self._solid], self._rest)

    @cached_property
    def _searchable(self) -> bool:
        """Whether the pairs of faces that cut at rest can be searched."""
        try:
            intersecting_faces(self._rest, self._faces)
        except TooManyPairsError:
            return False
        return True

    def find(self, verts: Floats, last: Found | None = None) -> Found:
        """Return the faults of vertices (V, 3) float64.

        `last`: those of a shape before; where few vertices moved since, only around these are pairs searched again.
        """
        verts = without_rounding(self._rest, verts)
        folded = np.zeros(len(self._faces), bool)
        folded[self._solid] = self._neighbours.folded(verts)
        if not self._searchable:
            return Found(verts, folded, _NO_PAIRS, self._areas)
        try:
            return Found(verts, folded, self._pairs(verts, last), self._areas)
        except TooManyPairsError:
            self.searched += _GIVEN_UP * len(self._faces)
            return Found(verts, folded, _NO_PAIRS, self._areas, crowded=True)

    def _touching(self, some: Flags) -> Flags:
        """Return which faces (F,) have one of some vertices (V,)."""
        a, b, c = self._faces.T
        return np.asarray(some[a] | some[b] | some[c])

    def _pairs(self, verts: Floats, last: Found | None) -> Index:
        """List the pairs that newly cut."""
        changed = np.ones(len(self._faces), bool)
        if last is not None and not last.crowded:
            changed = self._touching(np.logical_or.reduce((verts != last.verts).T))
        if last is None or changed.mean() > _LOCAL:
            self.searched += len(self._faces)
            return self._new(cutting_pairs(verts, self._faces))
        near = np.flatnonzero(faces_near(verts, self._faces, changed))
        self.searched += len(near)
        pairs = self._new(near[cutting_pairs(verts, self._faces[near])])
        pairs = np.concatenate([pairs[changed[pairs].any(1)], last.pairs[~changed[last.pairs].any(1)]])
        return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])

    def _new(self, pairs: Index) -> Index:
        """Return those pairs (P, 2) that do not touch at rest."""
        if len(self._seen) > _KNOWN:
            self._seen = self._touching_at_rest = np.zeros(0, np.int64)
        keys = pairs @ [len(self._faces), 1]
        unseen = ~np.isin(keys, self._seen)
        if unseen.any():
            touching = touching_at_rest(self._rest, self._faces, pairs[unseen])
            self._seen = np.concatenate([self._seen, keys[unseen]])
            self._touching_at_rest = np.concatenate([self._touching_at_rest, keys[unseen][touching]])
        return np.asarray(pairs[~np.isin(keys, self._touching_at_rest)])
