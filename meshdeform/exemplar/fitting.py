"""Fit a surface to another one whose parts are known as well: piece to piece, then smoothly, then mended.

1. Pieces with like names are matched (`pieces`), and the goal takes the source's pose (`posing`).
2. Each piece goes to its partner by an affine map (`affine_maps`); the maps are blended over the surface (`blending`).
3. What is not built is fitted smoothly, like pieces to like pieces (`smooth_fit`). What only the goal has counts with
   the piece from which it grows, with limits three times as wide.
4. Faces that turned over or cut others are mended (`mending`).

The plate on which an asset stands is left as it is. Without any matched piece there is only the smooth fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshdeform.exemplar.affine_maps import Cloud, Manner, articulated, touching
from meshdeform.exemplar.blending import blend_weights, blended
from meshdeform.exemplar.growth import grown
from meshdeform.exemplar.kinds import is_boxed, is_built, is_living
from meshdeform.exemplar.mending import Mended, mended
from meshdeform.exemplar.pieces import Matching, face_areas, matched, neighbours
from meshdeform.exemplar.posing import posed_like
from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.smooth_fit import smooth_fit
from meshdeform.exemplar.symmetry import evened, symmetry_axes
from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.result import GROUND
from meshdeform.reading.samples import hidden, spread

__all__ = ["Fitted", "fit"]

_SAMPLES, _GOAL_SAMPLES = 1600, 3000
_LEVELS, _LIMITS, _REACH = ((3, 3), (6, 5), (12, 5)), (0.15, 0.05), 3.0
_SPROUTING = frozenset(("ear", "nose", "beak", "trunk", "horn", "fin", "tail", "hump"))
"""Parts that sprout from a surface that lacks them."""
_MUCH = 2.5
_ALONE = ((3, 6), (6, 6), (12, 5))


@dataclass(frozen=True)
class Fitted:
    """A source fitted to its goal.

    `verts` (V, 3) float64; `blended` and `smooth`: the stages before mending; `goal`: the goal in the source's pose;
    `matching`: pieces of both, None if the parts of one are unknown.
    """

    verts: Floats
    blended: Floats
    smooth: Floats
    goal: Shape
    matching: Matching | None
    mended: Mended


def fit(source: Shape, goal: Shape, *, landmarks: tuple[Floats, Floats] | None = None) -> Fitted:
    """Fit a source to a goal; both lie in the source's frame.

    `landmarks`: places (L, 3) of the source and their goals.
    """
    standing = source.labels != GROUND
    own = Shape(source.noun, source.verts, source.faces[standing], source.labels[standing])
    samples = spread(own.verts, own.faces, _SAMPLES, 1)
    planes = symmetry_axes((own.verts, own.faces), (goal.verts, goal.faces))
    matching = matched(own, goal)
    if not (matching.partner >= 0).any():
        alone = _alone(own, goal, planes, landmarks)
        return _finished(source, goal, None, source.verts.copy(), evened(own.verts, alone, planes), standing)
    cloud = Cloud(samples.places, samples.normals, matching.source.of_face[samples.faces]).known()
    goal = posed_like(cloud, goal, matching)
    manner = Manner(
        straight=not is_living(source.noun) and not is_living(goal.noun),
        boxed=is_boxed(source.noun) and is_boxed(goal.noun),
        mirrored=0 in planes,
    )
    ties = touching(cloud, len(matching.source), _borders(own, matching))
    names = matching.source.names
    maps = articulated(cloud, _seen(goal, matching), names, matching.partner, ties, manner)
    loose = np.array([name == "wheel" for name in names])
    weights = blend_weights(own.verts, own.faces, matching.source.of_face, loose)
    first = blended(own.verts, maps, weights)
    first[weights.sum(1) == 0] = own.verts[weights.sum(1) == 0]
    smooth = first
    if not (is_built(source.noun) and is_built(goal.noun)):
        smooth = _smooth(own, goal, matching, _Codes.of(own, goal, matching, weights), first, planes, landmarks)
    return _finished(source, goal, matching, first, evened(own.verts, smooth, planes), standing)


def _borders(own: Shape, matching: Matching) -> dict[tuple[int, int], Floats]:
    """Return the middles (P, 3) of the edges between two pieces."""
    pairs = neighbours(own.faces, len(own.verts))
    pieces = np.sort(matching.source.of_face[pairs], 1)
    hit = (pieces[:, 0] != pieces[:, 1]) & (pieces[:, 0] >= 0)
    pairs, pieces = pairs[hit], pieces[hit]
    middles = own.verts[own.faces[pairs]].mean((1, 2))
    keys = [tuple(row) for row in np.unique(pieces, axis=0).tolist()]
    return {key: middles[(pieces == key).all(1)] for key in keys}


def _seen(goal: Shape, matching: Matching) -> Cloud:
    """Return samples of the goal that are not inside others of its solids."""
    samples = spread(goal.verts, goal.faces, _GOAL_SAMPLES, 2)
    if goal.solids is not None:
        samples = samples.rows(~hidden(samples, goal.solids[samples.faces]))
    return Cloud(samples.places, samples.normals, matching.goal.of_face[samples.faces]).known()


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
    source: Shape,
    goal: Shape,
    matching: Matching | None,
    first: Floats,
    smooth: Floats,
    standing: Flags,
) -> Fitted:
    """Mend a fit; the ground stays."""
    ground = np.unique(source.faces[~standing])
    for stage in (first, smooth):
        stage[ground] = source.verts[ground]
    result = mended(source.verts, smooth, source.faces)
    return Fitted(result.verts, first, smooth, goal, matching, result)
