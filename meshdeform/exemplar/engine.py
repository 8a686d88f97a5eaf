"""Turn an asset into what a noun stands for.

1. An asset that is the noun already, wished with attributes of parts, moves as the attributes do (`twins`).
2. A lump without parts is moulded (`clay`).
3. Else the nearest members are chosen (`choosing`), or the nearest of given surfaces; the asset is fitted to each
   (`fitting`), and the one with the least

       distance + 0.02 stretch + 0.05 (1 - kept)

   is taken: the distance left between the surfaces, how far the asset was stretched (`distances`), and what mending
   left of the fit.

With a strength below 1 the asset goes that share of the way, and what breaks on it is mended.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshdeform.exemplar.choosing import Exemplar, exemplars
from meshdeform.exemplar.clay import is_clay, moulded
from meshdeform.exemplar.distances import between, stretch
from meshdeform.exemplar.fitting import fit
from meshdeform.exemplar.mending import Mended, mended
from meshdeform.exemplar.pieces import Matching, face_areas
from meshdeform.exemplar.shapes import ExemplarResult, Shape, Wish, frame_of
from meshdeform.exemplar.twins import twin
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.result import GROUND, NO_PART, Reading
from meshdeform.reading.samples import hidden, spread

__all__ = ["ExemplarFit", "Stage"]

_TRIED = 3
_STRETCH, _LOST = 0.02, 0.05
_SAMPLES = 2500
_CHOSEN, _FITTED = 0.2, 0.95


@dataclass(frozen=True)
class Stage:
    """What is done so far: `share` of the work, and the vertices (V, 3) in the asset's own coordinates if any moved."""

    name: str
    share: float
    verts: Floats | None = None


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
    ) -> None:
        if labels is None:
            labels = np.full(len(faces), NO_PART, np.int64) if reading is None else reading.labels
        self.frame = frame_of(verts, faces, reading)
        noun = "" if reading is None else reading.noun
        faces = np.asarray(faces, np.int64)
        self.source = Shape(noun, self.frame.enter(verts), faces, labels)
        self._wish, self._cache = wish, cache
        standing = faces[labels != GROUND]
        self._standing = standing if len(standing) else faces

    def __iter__(self) -> Iterator[Stage]:
        """Yield what is done, stage by stage; sets `result`."""
        result = self._twin()
        if result is None:
            chosen = self._chosen()
            yield Stage("choose", _CHOSEN)
            tries = []
            for number, exemplar in enumerate(chosen):
                tries.append(self._tried(exemplar))
                share = _CHOSEN + (_FITTED - _CHOSEN) * (number + 1) / len(chosen)
                yield Stage("fit", share, self._left(min(tries, key=self._merit)))
            result = min(tries, key=self._merit)
        self.result = self._weakened(result)
        yield Stage("mend", 1.0, self._left(self.result))

    def _left(self, result: ExemplarResult) -> Floats:
        """Return the vertices of a result in the asset's own coordinates."""
        return self.frame.leave(result.verts)

    @staticmethod
    def _merit(result: ExemplarResult) -> float:
        return result.distance + _STRETCH * result.stretch + _LOST * (1 - result.kept)

    def _twin(self) -> ExemplarResult | None:
        """Return the asset with attributes of its parts, if it is the wished noun and has any."""
        wish, source = self._wish, self.source
        if wish.targets or source.noun != wish.noun or not any(each.part != "whole" for each in wish.attributes):
            return None
        verts = twin(source, wish, cache=self._cache)
        if verts is None:
            return None
        done = mended(source.verts, verts, source.faces)
        told = {"noun": wish.noun, "way": "twin", "attributes": [str(each) for each in wish.attributes]}
        return self._measured(done, told, None, None)

    def _chosen(self) -> list[Exemplar]:
        if self._wish.targets:
            return [
                Exemplar(target, self._distance(self.source.verts, target), 0.0, {"target": number})
                for number, target in enumerate(self._wish.targets)
            ]
        return exemplars(self.source, self._wish, _TRIED, cache=self._cache)

    def _tried(self, exemplar: Exemplar) -> ExemplarResult:
        """Fit the asset to an exemplar."""
        source = self.source
        if not self._wish.targets and is_clay(source):
            done = mended(source.verts, moulded(source, exemplar.shape), source.faces)
            return self._measured(done, {**exemplar.told, "way": "mould"}, exemplar.shape, None)
        fitted = fit(source, exemplar.shape, landmarks=self._wish.landmarks)
        return self._measured(fitted.mended, {**exemplar.told, "way": "fit"}, fitted.goal, fitted.matching)

    def _measured(
        self, done: Mended, told: Mapping[str, object], goal: Shape | None, matching: Matching | None
    ) -> ExemplarResult:
        """Return the facts of a mended fit."""
        pairs, left_over, missing = _told(matching)
        return ExemplarResult(
            done.verts,
            told,
            0.0 if goal is None else self._distance(self.source.verts, goal),
            0.0 if goal is None else self._distance(done.verts, goal),
            pairs,
            left_over,
            missing,
            done.kept,
            done.flipped,
            done.cut,
            stretch(self.source.verts, done.verts, self._standing),
        )

    def _distance(self, verts: Floats, goal: Shape) -> float:
        """Return the mean distance between the asset and what is seen of a goal."""
        own = spread(verts, self._standing, _SAMPLES, 3)
        other = spread(goal.verts, goal.faces, _SAMPLES, 4)
        if goal.solids is not None:
            other = other.rows(~hidden(other, goal.solids[other.faces]))
        spacing = float(np.sqrt(face_areas(verts, self._standing).sum() / _SAMPLES))
        return between(own, other, spacing)

    def _weakened(self, result: ExemplarResult) -> ExemplarResult:
        """Return a result that goes only the wished share of the way."""
        if self._wish.strength >= 1:
            return result
        rest = self.source.verts
        done = mended(rest, rest + self._wish.strength * (result.verts - rest), self.source.faces)
        moved = stretch(rest, done.verts, self._standing)
        return replace(result, verts=done.verts, flipped=done.flipped, cut=done.cut, stretch=moved)


def _told(matching: Matching | None) -> tuple[list[tuple[str, str]], list[str], list[str]]:
    """Return which parts went to each other, and which only one has."""
    if matching is None:
        return [], [], []
    own, other = matching.source.names, matching.goal.names
    pairs = Counter((own[piece], other[partner]) for piece, partner in enumerate(matching.partner) if partner >= 0)
    left_over = sorted({own[piece] for piece in np.flatnonzero(matching.partner < 0)} - {one for one, _ in pairs})
    missing = sorted({other[piece] for piece in np.flatnonzero(matching.grows)} - {two for _, two in pairs})
    return sorted(pairs), left_over, missing
