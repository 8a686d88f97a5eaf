"""Fit a surface to another one whose parts are known as well: piece to piece, then smoothly, then mended.

1. Pieces with like names are matched (`pieces`).
2. Few maps bring the source near the goal (`starting`).
3. What came there piece by piece is fitted smoothly, like pieces to like pieces (`smooth_fit`). What only the
   goal has counts with the piece from which it grows, with limits three times as wide.
4. A rocket or a lighthouse is hardly its parts: what was brought near it is fitted as a whole, all to all.
5. It slides along the goal until it is distorted less (`relaxing`), but for what is built.
6. Faces that turned over or cut others are mended (`mending`).

The plate on which an asset stands is left as it is. Without any matched piece there is only the smooth fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshdeform.exemplar.growth import grown
from meshdeform.exemplar.kinds import is_built, is_tower
from meshdeform.exemplar.pieces import Matching, Pieces, matched
from meshdeform.exemplar.relaxing import relaxed
from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.smooth_fit import LEVELS, LIMITS, CodedSurface, pulls_to, smooth_fit
from meshdeform.exemplar.starting import cloud_of, piece_weights, started
from meshdeform.exemplar.symmetry import evened, is_even
from meshdeform.geometry.mesh import face_areas
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.result import GROUND
from meshdeform.reading.samples import hidden, resampled

__all__ = ["Fitted", "SourceFit"]

_LEVELS, _LIMITS, _REACH = ((3, 3), (6, 5), (12, 5)), (0.15, 0.05), 3.0
_SPROUTING = frozenset(("ear", "nose", "beak", "trunk", "horn", "fin", "tail", "hump", "wing"))
"""Parts that sprout from a surface that lacks them."""
_MUCH = 2.5
_WHOLE_LIMITS = (0.3, 0.06)


@dataclass(frozen=True)
class Fitted:
    """A source fitted to its goal.

    `goal`: the goal in the source's pose; `matching`: pieces of both, None if none of them match; `ways`: where the
    source's vertices (V, 3) go, with folds and cuts: first by the way that suits the nouns, `smooth`,
    `axes`, `side`, `outline` or `whole`, then by others.
    """

    goal: Shape
    matching: Matching | None
    ways: dict[str, Floats]


class SourceFit:
    """A source that is fitted to several goals."""

    def __init__(self, source: Shape) -> None:
        self.source, self._standing = source, source.labels != GROUND
        standing = self._standing
        solids = None if source.solids is None else source.solids[standing]
        self._own = Shape(source.noun, source.verts, source.faces[standing], source.labels[standing], solids)
        self._even = [axis for axis in (0, 2) if is_even(self._own.verts, self._own.faces, axis)]
        self._weights: tuple[Pieces, Floats] | None = None

    def fit(self, goal: Shape, *, landmarks: tuple[Floats, Floats] | None = None) -> Fitted:
        """Fit the source to a goal in its frame; `landmarks`: points (L, 3) of the source, and their goals."""
        own, matching = self._own, matched(self._own, goal)
        planes = self._planes(goal)
        if not (matching.partner >= 0).any():
            return self._finished(goal, None, {"smooth": _whole(own, goal, planes, landmarks)}, planes)
        cloud = cloud_of(own, matching)
        weights = self._piece_weights(matching.source)
        ways = started(own, goal, matching, cloud, weights, mirrored=0 in planes)
        if "pieces" in ways:
            codes = _Codes.of(own, goal, matching, weights)
            ways = {"smooth": _smooth(own, goal, matching, codes, ways["pieces"], planes, landmarks), **ways}
        if is_tower(goal.noun):
            near = next(ways[name] for name in ("outline", "axes", "smooth") if name in ways)
            ways = {"whole": _whole(own.moved(near), goal, planes, landmarks, _WHOLE_LIMITS), **ways}
        return self._finished(goal, matching, ways, planes)

    def _planes(self, goal: Shape) -> tuple[int, ...]:
        return tuple(axis for axis in self._even if axis == 0 or is_even(goal.verts, goal.faces, axis))

    def _piece_weights(self, pieces: Pieces) -> Floats:
        """Return the weights of pieces, which are mostly the same for all goals."""
        if self._weights is not None:
            known, weights = self._weights
            if known.names == pieces.names and np.array_equal(known.of_face, pieces.of_face):
                return weights
        self._weights = pieces, piece_weights(self._own, pieces)
        return self._weights[1]

    def _finished(
        self, goal: Shape, matching: Matching | None, ways: dict[str, Floats], planes: tuple[int, ...]
    ) -> Fitted:
        """Return a fit in which mirror images stay such, and the ground stays."""
        return Fitted(goal, matching, {name: self._even_over(each, planes) for name, each in ways.items()})

    def _even_over(self, verts: Floats, planes: tuple[int, ...]) -> Floats:
        ground = np.unique(self.source.faces[~self._standing])
        even = evened(self._own.verts, verts, planes)
        even[ground] = self.source.verts[ground]
        return even

    def relaxed(self, fitted: Fitted, verts: Floats) -> Floats:
        """Return the vertices (V, 3) of a smooth way along which the surface slid; what is built is left as it is."""
        own, goal = self._own, fitted.goal
        if is_built(own.noun) or is_built(goal.noun):
            return verts
        return self._even_over(relaxed(own.verts, verts, own.faces, goal.verts, _seen(goal)), self._planes(goal))


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


def _seen(goal: Shape) -> Index:
    """Return the faces (F, 3) of a goal that do not lie inside another of its solids."""
    if goal.solids is None:
        return goal.faces
    count = len(goal.faces)
    middles = resampled(goal.verts, goal.faces, np.arange(count), np.full((count, 3), 1 / 3))
    return goal.faces[~hidden(middles, goal.solids)]


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
        CodedSurface(first, own.faces, codes.own),
        CodedSurface(goal.verts, goal.faces[kept], codes.goal[kept]),
        planes=planes,
        levels=_LEVELS,
        limits=_LIMITS,
        reach=np.where(grows[kept], _REACH, 1.0),
        pulls=pulls_to(landmarks),
    )
    if not codes.sprouting and not codes.much:
        return smooth
    kept = codes.goal >= 0
    return grown(
        CodedSurface(smooth, own.faces, codes.own),
        CodedSurface(goal.verts, goal.faces[kept], codes.goal[kept]),
        parents=codes.sprouting,
        much=codes.much,
        before=first,
    )


def _whole(
    own: Shape,
    goal: Shape,
    planes: tuple[int, ...],
    landmarks: tuple[Floats, Floats] | None,
    near: tuple[float, float] | None = None,
) -> Floats:
    """Fit a source smoothly, all to all; `near`: the limits for one that lies near already, and may lose its edges."""
    built = near is None and is_built(own.noun) and is_built(goal.noun)
    return smooth_fit(
        CodedSurface.alike(own.verts, own.faces),
        CodedSurface.alike(goal.verts, goal.faces),
        planes=planes,
        built=built,
        levels=LEVELS,
        limits=near or LIMITS,
        pulls=pulls_to(landmarks),
    )
