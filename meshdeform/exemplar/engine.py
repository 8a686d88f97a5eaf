"""Turn an asset into what a noun stands for.

1. A lump without parts is moulded (`clay`).
2. To the nearest of given surfaces it is fitted as `targets` does, or piece by piece if their parts are known.
3. With a part of another noun, what it is already is fitted to itself with that part (`borrowing`).
4. Else the nearest members are chosen (`choosing`), the asset is fitted to each (`fitting`), and the one with the least

       distance + 0.02 stretch + 0.02 faults

   is taken: the distance left between the surfaces, how far the asset was stretched (`distances`), and the share of
   faces that fold or newly cut others. If mending leaves under 0.6 of it, the next is mended as well, and the one of
   which more is left is taken.

With a strength below 1 the asset goes that share of the way, and what breaks on it is mended.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from meshdeform.exemplar.borrowing import with_part_of
from meshdeform.exemplar.cached_sources import cached_source
from meshdeform.exemplar.choosing import Exemplar, exemplars
from meshdeform.exemplar.clay import is_clay, moulded
from meshdeform.exemplar.distances import mean_distance, stretch
from meshdeform.exemplar.mending import Mended, mended
from meshdeform.exemplar.pieces import Matching
from meshdeform.exemplar.shapes import ExemplarResult, Shape, Wish, frame_of
from meshdeform.exemplar.symmetry import is_even
from meshdeform.exemplar.targets import fitted_to_target
from meshdeform.geometry.mesh import face_areas
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.result import GROUND, NO_PART, Reading
from meshdeform.reading.samples import hidden, spread
from meshdeform.support.recent import Recent
from meshdeform.vocabulary.solids import PART_NAMES, part_label
from meshdeform.words import words_in_use

__all__ = ["ExemplarFit", "Stage"]

_TRIED, _MENDED = 3, 2
_LENDERS = 12
"""Members among which the nearest that has a part lends it: not every kind of a noun has all its parts."""
_ENOUGH = 0.6
_STRETCH, _FAULTS = 0.02, 0.02
_SAMPLES = 2500
_CHOSEN, _FITTED = 0.2, 0.95
_MOST, _MOST_BYTES, _COPIES = 64, 128 * 2**20, 3
"""Wishes whose ways are kept, and what they take: each way also before it was evened, and with its pieces."""
_recent: Recent[list[_Way]] = Recent(_MOST, _MOST_BYTES)


@dataclass(frozen=True)
class Stage:
    """What is done so far: `share` of the work, and the vertices (V, 3) in the asset's own coordinates if any moved."""

    name: str
    share: float
    verts: Floats | None = None


@dataclass
class _Way:
    """Where one exemplar takes the asset: vertices (V, 3) in the frame, before mending, and what it was.

    `finish`: what is still to be done to the vertices if the way is taken; `finished`: what they are then, once it was.
    """

    verts: Floats
    told: Mapping[str, object]
    goal: Shape
    matching: Matching | None = None
    merit: float | None = None
    finish: Callable[[Floats], Floats] | None = None
    finished: Floats | None = None


class ExemplarFit:
    """A fit of an asset to what it is to become: iterate over its stages, then take `result`.

    Parameters
    ----------
    verts, faces : (V, 3) float64, (F, 3) int64
        The asset, +Y up, in its own unit.
    reading : Reading or None
        What was found of it; None: nothing, and it lies as it is to be.
    wish : Wish
        What it is to become; its landmarks and targets in the frame of the fit, `frame`.
    labels : (F,) int64, optional
        The part of each face, in place of the reading's.
    cache : Path, optional
        A folder in which tables of members are kept (`reading.banks`).
    mends : bool
        False: what the fit broke is left so, which takes half the time.
    """

    result: ExemplarResult

    def __init__(
        self,
        verts: Floats,
        faces: Index,
        reading: Reading | None,
        wish: Wish,
        *,
        labels: Index | None = None,
        cache: Path | None = None,
        mends: bool = True,
    ) -> None:
        if labels is None:
            labels = np.full(len(faces), NO_PART, np.int64) if reading is None else reading.labels
        self.frame = frame_of(verts, faces, reading)
        noun = "" if reading is None else reading.noun
        faces = np.asarray(faces, np.int64)
        self.source = Shape(noun, self.frame.enter(verts), faces, labels)
        self._wish, self._cache, self._mends = wish, cache, mends
        standing = faces[labels != GROUND]
        self._standing = standing if len(standing) else faces
        self._cached = cached_source(self.source)
        self._faults, self._fit = self._cached.faults, self._cached.fit

    def __iter__(self) -> Iterator[Stage]:
        """Yield what is done, stage by stage; sets `result`."""
        found = None if self._key is None else _recent.get(self._key)
        ways = list[_Way]() if found is None else found
        chosen = self._chosen() if found is None else []
        yield Stage("choose", _CHOSEN)
        clay = not self._wish.targets and is_clay(self.source)
        for number, exemplar in enumerate(chosen):
            ways += [self._moulded(exemplar)] if clay else self._fitted(exemplar)
            share = _CHOSEN + (_FITTED - _CHOSEN) * (number + 1) / len(chosen)
            yield Stage("fit", share, self.frame.leave(min(ways, key=self._merit).verts))
        ways.sort(key=self._merit)
        self._remember(ways)
        self.result = self._mended(ways)
        yield Stage("mend", 1.0, self.frame.leave(self.result.verts))

    @cached_property
    def _key(self) -> Hashable | None:
        """What the ways of a source depend on: all of a wish but its strength; None of one for given surfaces."""
        wish = self._wish
        if wish.targets or wish.landmarks is not None:
            return None
        return self._cached.key, replace(wish, strength=1.0), tuple(word.sha256 for word in words_in_use())

    def _remember(self, ways: list[_Way]) -> None:
        """Remember where the asset can go, for the same wish with another strength."""
        if self._key is not None:
            size = sum(way.verts.nbytes + way.goal.verts.nbytes + way.goal.faces.nbytes for way in ways)
            _recent.put(self._key, ways, _COPIES * size)

    def _chosen(self) -> list[Exemplar]:
        if self._wish.targets:
            away = [self._distance(self.source.verts, target) for target in self._wish.targets]
            nearest = int(np.argmin(away))
            return [Exemplar(self._wish.targets[nearest], away[nearest], away[nearest], {"target": nearest})]
        wish = self._wish
        if wish.borrowed and wish.noun == self.source.noun and not wish.attributes:
            chosen = [Exemplar(self._cached.compared.shape, 0.0, 0.0, {"noun": wish.noun, "form": "the asset itself"})]
        else:
            chosen = exemplars(self.source, wish, _TRIED, cache=self._cache, compared=self._cached.compared)
        return [self._borrowing(one) for one in chosen]

    def _borrowing(self, exemplar: Exemplar) -> Exemplar:
        """Return an exemplar with the parts of other nouns that are wished."""
        shape, told = exemplar.shape, []
        for each in self._wish.borrowed:
            other = Wish(each.noun, each.attributes, seed=self._wish.seed)
            part = part_label(each.part)
            near = exemplars(self.source, other, _LENDERS, cache=self._cache, compared=self._cached.compared)
            lender = next((one for one in near if (one.shape.labels == PART_NAMES.index(part)).any()), near[0])
            shape = with_part_of(shape, lender.shape, part)
            told.append({**lender.told, "part": each.part})
        return replace(exemplar, shape=shape, told={**exemplar.told, "borrowed": told}) if told else exemplar

    def _moulded(self, exemplar: Exemplar) -> _Way:
        return _Way(moulded(self.source, exemplar.shape), {**exemplar.told, "way": "mould"}, exemplar.shape)

    def _fitted(self, exemplar: Exemplar) -> list[_Way]:
        """Return the ways in which the asset was fitted to an exemplar."""
        source, goal, landmarks = self.source, exemplar.shape, self._wish.landmarks
        if self._wish.targets and not (goal.labels >= 0).any():
            own = Shape(source.noun, source.verts, self._standing, np.full(len(self._standing), NO_PART))
            surfaces = (own, goal)
            planes = [axis for axis in (0, 2) if all(is_even(each.verts, each.faces, axis) for each in surfaces)]
            verts = fitted_to_target(own, goal, planes=planes, landmarks=landmarks)
            return [_Way(verts, {**exemplar.told, "way": "target"}, goal)]
        fitted = self._fit.fit(goal, landmarks=landmarks)
        return [
            _Way(
                verts,
                {**exemplar.told, "way": name},
                fitted.goal,
                fitted.matching,
                finish=partial(self._fit.relaxed, fitted) if name == "smooth" else None,
            )
            for name, verts in fitted.ways.items()
        ]

    def _merit(self, way: _Way) -> float:
        """Return how far from good a way is."""
        if way.merit is None:
            left = self._distance(way.verts, way.goal)
            found = self._faults.find(way.verts)
            faulty = float((found.folded | found.cutting).mean())
            way.merit = left + _STRETCH * stretch(self.source.verts, way.verts, self._standing) + _FAULTS * faulty
        return way.merit

    def _mended(self, ways: Sequence[_Way]) -> ExemplarResult:
        """Return the facts of the best way, mended, or of the next if too little of it is left."""
        rest = self.source.verts
        best, done = ways[0], None
        for way in ways[:_MENDED]:
            now = self._moved_along(way)
            if done is None or now.kept > done.kept:
                best, done = way, now
            if done.kept >= _ENOUGH:
                break
        assert done is not None
        pairs, left_over, missing = _parts_told(best.matching)
        return ExemplarResult(
            done.verts,
            best.told,
            self._distance(rest, best.goal),
            self._distance(done.verts, best.goal),
            pairs,
            left_over,
            missing,
            done.kept,
            done.flipped,
            done.cut,
            stretch(rest, done.verts, self._standing),
        )

    def _moved_along(self, way: _Way) -> Mended:
        """Return where the asset has gone that way, as far as it is to go."""
        rest = self.source.verts
        if self._mends and way.finish is not None and way.finished is None:
            way.finished = way.finish(way.verts)
        verts = way.finished if self._mends and way.finished is not None else way.verts
        goal = rest + self._wish.strength * (verts - rest)
        if self._mends:
            return mended(rest, goal, self.source.faces)
        found = self._faults.find(goal)
        return Mended(found.verts, 1.0, int(found.folded.sum()), int(found.cutting.sum()))

    def _distance(self, verts: Floats, goal: Shape) -> float:
        """Return the mean distance between the asset and what is seen of a goal."""
        own = spread(verts, self._standing, _SAMPLES, 3)
        other = spread(goal.verts, goal.faces, _SAMPLES, 4)
        if goal.solids is not None:
            other = other.rows(~hidden(other, goal.solids[other.faces]))
        spacing = float(np.sqrt(face_areas(verts, self._standing).sum() / _SAMPLES))
        return mean_distance(own, other, spacing)


def _parts_told(matching: Matching | None) -> tuple[list[tuple[str, str]], list[str], list[str]]:
    """Return which parts went to each other, and which only one has."""
    if matching is None:
        return [], [], []
    own, other = matching.source.names, matching.goal.names
    pairs = Counter((own[piece], other[partner]) for piece, partner in enumerate(matching.partner) if partner >= 0)
    left_over = sorted({own[piece] for piece in np.flatnonzero(matching.partner < 0)} - {one for one, _ in pairs})
    missing = sorted({other[piece] for piece in np.flatnonzero(matching.grows)} - {two for _, two in pairs})
    return sorted(pairs), left_over, missing
