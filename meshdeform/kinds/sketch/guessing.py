"""Guess what a drawing shows: a noun at first sight, then the member, its sides and its sizes by a search.

Members of the likeliest nouns are drawn, kind by kind, from the sides that people draw, and the one whose lines are
nearest to those of the drawing is taken. Then its sliders and the view are moved for as long as the lines come nearer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.drawing import read_drawing
from meshdeform.kinds.sketch.lines import BEND, View, line_pictures
from meshdeform.kinds.sketch.looking import Projection, Singles, inked, read_projection
from meshdeform.kinds.sketch.matching import DrawnLines, distance
from meshdeform.kinds.sketch.shapes import known_noun, nouns, shape, shape_glb, sliders_of
from meshdeform.kinds.sketch.sliders import Number, Value
from meshdeform.words.in_use import own_word

__all__ = ["SURE", "Guess", "guess", "is_unsure"]

SURE = 0.95
"""Probability of the first guess from which on it is sure; docs/sketch.md has what this threshold tells."""
_GUESSES, _STARTS = 3, 12
_VIEWS = tuple(View(*each) for each in ((90.0, 6.0), (0.0, 6.0), (45.0, 14.0), (0.0, 80.0)))
_STEPS = (0.5, 0.25)
"""By how much of a part's size, and of twice a side, sliders are moved, in turn."""
_NEARER = 0.98
"""Share of a distance that is nearer: what the drawing hardly shows stays as it is."""
_TURN_DEG = 30.0
"""By how much the view is moved with a step of 1."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Guess:
    """One reading of a drawing."""

    noun: str
    probability: float  # that the drawing shows this noun and none of the others
    values: dict[str, Value]  # all sliders of the noun

    @classmethod
    def of(cls, noun: str, probability: float, values: Mapping[str, object]) -> Self:
        """Return a guess with checked sliders; those left out have their default.

        Raises
        ------
        ParameterError
            There is no such noun, a name is unknown, or a value is out of range.
        """
        known = known_noun(noun)
        return cls(known, probability, sliders_of(known).checked(values))

    def glb(self) -> bytes:
        """Return the mesh as `shape_glb` does."""
        return shape_glb(self.noun, self.values)


def guess(data: bytes, *, noun: str = "") -> list[Guess]:
    """Return what a drawing may show, the likeliest first.

    Parameters
    ----------
    data : bytes
        A PNG, JPEG or WebP with dark lines on a bright page, or the reverse.
    noun : str
        The only noun to consider. Default: all, of which the first three are returned.

    Raises
    ------
    DrawingError
        The picture is no line drawing.
    ParameterError
        There is no such noun.
    ModelError
        The package's weights are missing or damaged.
    """
    only = known_noun(noun) if noun else ""
    picture = read_drawing(data)
    likely = _likely(picture)
    names = [only] if only else sorted(likely, key=lambda each: -likely[each])[:_GUESSES]
    return [Guess.of(name, round(likely[name], 4), _Search(picture, name).nearest().values) for name in names]


def is_unsure(guesses: Sequence[Guess], *, noun: str = "") -> bool:
    """Return whether a drawing may be of something else than the first guess; never if its `noun` was named."""
    return not noun and guesses[0].probability < SURE


def _likely(picture: Singles) -> dict[str, float]:
    """Return how likely a drawing shows each noun at first sight."""
    projection = read_projection()
    known = [noun for noun in nouns() if noun in projection.nouns and own_word(noun) is None]
    new = {noun: _place(noun, projection) for noun in nouns() if noun not in known}
    likely = projection.likelihoods(picture, new)
    return {noun: likely[noun] for noun in nouns()}


def _place(noun: str, projection: Projection) -> Singles:
    """Return the place of a noun that the projection does not know: of the lines of its members."""
    pages = [page for values in _starts(noun) for _, page in _drawn(noun, values, _VIEWS)]
    mean = projection.placed(np.stack([inked(page) for page in pages]), of_members=True).mean(0)
    return np.asarray(mean / np.linalg.norm(mean))


def _starts(noun: str) -> Iterator[dict[str, Value]]:
    """Yield sliders of members of a noun: all kinds and poses, then other variants of them."""
    sliders = sliders_of(noun)
    options = {each.name: each.options for each in sliders.choices}
    some: list[dict[str, str]] = [{"kind": kind} for kind in options.get("kind", ())]
    some += [{"pose": pose} for pose in options.get("pose", ())[1:]]
    for number in range(min(_STARTS, max(len(some), 1) * len(options["variant"]))):
        each = some[number % len(some)] if some else {}
        yield sliders.checked({**each, "variant": options["variant"][number // max(len(some), 1)]})


def _drawn(noun: str, values: Mapping[str, object], views: Sequence[View]) -> list[tuple[View, NDArray[np.uint8]]]:
    made = shape(noun, values)
    return line_pictures(made.verts, made.faces, made.labels, views)


@dataclass(frozen=True)
class _Found:
    """A member from a view, and how far its lines are from the drawing; `mirrored`: from its mirror image."""

    values: dict[str, Value]
    view: View
    mirrored: bool
    distance: float


class _Search:
    """The search for the member of a noun."""

    def __init__(self, picture: Singles, noun: str) -> None:
        self._noun = noun
        self._drawing = [DrawnLines(each) for each in (picture, picture[:, ::-1])]

    def _graded(self, values: dict[str, Value], views: Sequence[View], mirrored: Sequence[bool]) -> Iterator[_Found]:
        for view, page in _drawn(self._noun, values, views):
            lines = DrawnLines(((page & ~np.uint8(BEND)) > 0).astype(np.float32))
            for each in mirrored:
                yield _Found(values, view, each, distance(self._drawing[each], lines))

    def nearest(self) -> _Found:
        """Return the nearest of some members, of which one slider after the other, and the view, has been moved."""
        every = [found for values in _starts(self._noun) for found in self._graded(values, _VIEWS, (False, True))]
        best = min(every, key=lambda each: each.distance)
        numbers = sliders_of(self._noun).numbers
        for step in _STEPS:
            for about in (None, *numbers):
                for by in (step, -step):
                    values, view = best.values, best.view
                    if about is None:
                        view = replace(view, azimuth_deg=view.azimuth_deg + by * _TURN_DEG)
                    else:
                        values = values | {about.name: _moved(about, float(values[about.name]), by)}
                    found = next(self._graded(values, [view], [best.mirrored]))
                    if found.distance < _NEARER * best.distance:
                        best = found
                        break
        return best


def _moved(about: Number, value: float, by: float) -> float:
    """Return a slider's value moved: sides by a factor, parts by a sum."""
    moved = value * 2**by if about.low > 0 else value + by
    return round(min(max(moved, about.low), about.high), 3)
