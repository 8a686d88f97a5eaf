"""Fit a surface to another one whose parts are known as well: piece to piece, then smoothly, then mended.

1. Pieces with like names are matched (`pieces`), and the goal takes the source's pose (`posing`).
2. Few maps bring the source near the goal (`starting`).
3. What came there piece by piece is fitted smoothly, like pieces to like pieces (`smooth_fit`). What only the goal has counts with
   the piece from which it grows, with limits three times as wide.
4. Faces that turned over or cut others are mended (`mending`).

The plate on which an asset stands is left as it is. Without any matched piece there is only the smooth fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshdeform.exemplar.growth import grown
from meshdeform.exemplar.kinds import is_built
from meshdeform.exemplar.mending import Mended, mended
from meshdeform.exemplar.pieces import Matching, face_areas, matched
from meshdeform.exemplar.posing import posed_like
from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.smooth_fit import smooth_fit
from meshdeform.exemplar.starting import cloud_of, started
from meshdeform.exemplar.symmetry import evened, symmetry_axes
from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.result import GROUND

__all__ = ["Fitted", "fit"]

_LEVELS, _LIMITS, _REACH = ((3, 3), (6, 5), (12, 5)), (0.15, 0.05), 3.0
_SPROUTING = frozenset(("ear", "nose", "beak", "trunk", "horn", "fin", "tail", "hump", "wing"))
"""Parts that sprout from a surface that lacks them."""
_MUCH = 2.5
_ALONE = ((3, 6), (6, 6), (12, 5))


@dataclass(frozen=True)
class Fitted:
    """A source fitted to its goal.

    `goal`: the goal in the source's pose; `matching`: pieces of both, None if none of them match; `ways`: where the
    source's vertices (V, 3) go, with folds and cuts: in the first place by the way that suits the nouns, `smooth`,
    `axes` or `outline`, then by others.
    """

    source: Shape
    goal: Shape
    matching: Matching | None
    ways: dict[str, Floats]

    @cached_property
    def mended(self) -> Mended:
        """The first way without folds and with few cuts."""
        return mended(self.source.verts, next(iter(self.ways.values())), self.source.faces)

    @property
    def verts(self) -> Floats:
        """The vertices (V, 3) of the mended fit."""
        return self.mended.verts


def fit(source: Shape, goal: Shape, *, landmarks: tuple[Floats, Floats] | None = None) -> Fitted:
    """Fit a source to a goal; both lie in the source's frame.

    `landmarks`: places (L, 3) of the source and their goals.
    """
    standing = source.labels != GROUND
    own = Shape(source.noun, source.verts, source.faces[standing], source.labels[standing])
    planes = symmetry_axes((own.verts, own.faces), (goal.verts, goal.faces))
    matching = matched(own, goal)
    if not (matching.partner >= 0).any():
        alone = evened(own.verts, _alone(own, goal, planes, landmarks), planes)
        return _finished(source, goal, None, {"smooth": alone}, standing)
    cloud = cloud_of(own, matching)
    goal = posed_like(cloud, goal, matching)
    start = started(own, goal, matching, cloud, planes)
    ways = {name: evened(own.verts, verts, planes) for name, verts in start.ways.items()}
    if "pieces" in ways:
        codes = _Codes.of(own, goal, matching, start.weights)
        smooth = _smooth(own, goal, matching, codes, ways["pieces"], planes, landmarks)
        ways = {"smooth": evened(own.verts, smooth, planes), **ways}
    return _finished(source, goal, matching, ways, standing)


@dataclass(frozen=True)
class _Codes:
    """The number of the piece of each face of the source and of its goal; alike where they are fitted to each other.

    A piece of the goal has that of its parent; one that sprouts a number of its own, from `first` on. Faces of the goal
    that are left out have -1.
    """

    own: Index
    goal: Index
    sprouting: dict[int, int]
    much: set[int]

    @classmethod
    def of(cls, own: Shape, goal: Shape, matching: Matching, weights: Floats) -> _Codes:
        """Number the pieces; faces of no part count with the piece that weighs most at their corners."""
        count, filled = len(matching.source), matching.source.of_face.copy()
        filled[filled < 0] = weights[own.faces[filled < 0]].sum(1).argmax(1)
        codes = np.where(matching.partner >= 0, np.arange(count), count + np.arange(count))
        names = matching.goal.names
        sprouting = {
            2 * count + int(piece): int(matching.parent[piece])
            for piece in np.flatnonzero(matching.grows & (matching.parent >= 0))
            if names[piece] in _SPROUTING
        }
        goal_codes = matching.parent.copy()
        for code in sprouting:
            goal_codes[code - 2 * count] = code
        of_face = np.append(goal_codes, -1)[matching.goal.of_face]
        return cls(codes[filled], of_face, sprouting, cls._growing(own, goal, matching))

    @staticmethod
    def _growing(own: Shape, goal: Shape, matching: Matching) -> set[int]:
        """Return the pieces that must grow so much that their surface needs a fit of its own."""
        areas, goal_areas = face_areas(own.verts, own.faces), face_areas(goal.verts, goal.faces)
        much = set()
        for piece, partner in enumerate(matching.partner):
            if partner >= 0 and matching.source.names[piece] in _SPROUTING:
                area = areas[matching.source.of_face == piece].sum()
                if goal_areas[matching.goal.of_face == partner].sum() > _MUCH * area:
                    much.add(piece)
        return much


def _smooth(
    own: Shape,
    goal: Shape,
    matching: Matching,
    codes: _Codes,
    first: Floats,
    planes: tuple[int, ...],
    landmarks: tuple[Floats, Floats] | None,
) -> Floats:
    """Fit like pieces to like ones smoothly, then let grow what smooth maps do not give."""
    kept = (codes.goal >= 0) & ~np.isin(codes.goal, list(codes.sprouting))
    grows = np.append(matching.grows, False)[matching.goal.of_face]
    smooth = smooth_fit(
        first,
        own.faces,
        codes.own,
        goal.verts,
        goal.faces[kept],
        codes.goal[kept],
        planes=planes,
        levels=_LEVELS,
        limits=_LIMITS,
        reach=np.where(grows[kept], _REACH, 1.0),
        landmarks=landmarks,
    )
    if not codes.sprouting and not codes.much:
        return smooth
    kept = codes.goal >= 0
    return grown(
        smooth,
        own.faces,
        codes.own,
        goal.verts,
        goal.faces[kept],
        codes.goal[kept],
        parents=codes.sprouting,
        much=codes.much,
        before=first,
    )


def _alone(own: Shape, goal: Shape, planes: tuple[int, ...], landmarks: tuple[Floats, Floats] | None) -> Floats:
    """Fit a source smoothly where no parts are known."""
    codes, goal_codes = np.zeros(len(own.faces), np.int64), np.zeros(len(goal.faces), np.int64)
    built = is_built(own.noun) and is_built(goal.noun)
    return smooth_fit(
        own.verts,
        own.faces,
        codes,
        goal.verts,
        goal.faces,
        goal_codes,
        planes=planes,
        built=built,
        levels=_ALONE,
        landmarks=landmarks,
    )


def _finished(
    source: Shape, goal: Shape, matching: Matching | None, ways: dict[str, Floats], standing: Flags
) -> Fitted:
    """Return a fit in which the ground stays."""
    ground = np.unique(source.faces[~standing])
    for verts in ways.values():
        verts[ground] = source.verts[ground]
    return Fitted(source, goal, matching, ways)
