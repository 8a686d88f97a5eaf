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
from meshdeform.geometry.intersections import TooManyPairsError, intersecting_faces, newly_cutting_pairs
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["Faults", "Found"]


@dataclass(frozen=True)
class Found:
    """The faces (F,) of a deformed surface that are folded, and those that newly cut another one."""

    folded: Flags
    cutting: Flags

    def clean(self, share: float) -> bool:
        """Whether nothing is folded and at most this share of the faces cuts."""
        return not self.folded.any() and not self.too_many(share)

    def too_many(self, share: float) -> bool:
        """Whether more than this share of the faces cuts."""
        return int(self.cutting.sum()) > share * len(self.cutting)

    def to_mend(self, share: float) -> Flags:
        """Return which faces (F,) have to change: the folded ones, and if too many cut, those."""
        return self.folded | self.cutting if self.too_many(share) else self.folded


class Faults:
    """Finds the faults of shapes of the same faces (F, 3), whose vertices (V, 3) float64 lie at `rest` at first.

    Where so many faces lie on or in each other at rest that their pairs cannot be searched, no cuts are found; where
    only a deformed shape has so many, all its faces count as cutting.
    """

    def __init__(self, rest: Floats, faces: Index) -> None:
        self._rest, self._faces = np.ascontiguousarray(rest), np.ascontiguousarray(faces, np.int64)
        self.areas: Floats = np.linalg.norm(area_vectors(self._rest, self._faces), axis=1) / 2
        self._solid = np.flatnonzero(self.areas > COLLAPSED_SHAPE * longest_squared(self._rest, self._faces))
        self._neighbours = FaceNeighbours(self._faces[self._solid], self._rest)

    @cached_property
    def searchable(self) -> bool:
        """Whether the pairs of faces that cut at rest can be searched."""
        try:
            intersecting_faces(self._rest, self._faces)
        except TooManyPairsError:
            return False
        return True

    def find(self, verts: Floats) -> Found:
        """Return the faults of vertices (V, 3) float64."""
        verts = without_rounding(self._rest, verts)
        folded, cutting = (np.zeros(len(self._faces), bool) for _ in range(2))
        folded[self._solid] = self._neighbours.folded(verts)
        try:
            cutting[newly_cutting_pairs(self._rest, verts, self._faces).ravel()] = True
        except TooManyPairsError:
            cutting[:] = self.searchable
        return Found(folded, cutting)
