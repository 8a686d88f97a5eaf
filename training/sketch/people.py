"""Read drawings by people: the strokes of ndjson files (Quick, Draw! by Google, CC-BY 4.0), one of each word."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from meshdeform.assets.drawing import prepared
from meshdeform.vocabulary.nouns import NOUNS, SYNONYMS

_ALSO = {
    "ceiling fan": "fan",
    "cruise ship": "ship",
    "diamond": "crystal",
    "drums": "drum",
    "stop sign": "signpost",
    "swing set": "swing",
    "tennis racquet": "racket",
}
"""Words that are kinds of our nouns, and no other names of them."""
_MOST = 40
_PAGE, _DRAWN, _PEN = 256, 200, 4
"""Pixels of the page, of the longer side of a drawing, and of the pen: those of the page's pad, halved."""


@dataclass(frozen=True)
class People:
    """Drawings by people (N, SIDE, SIDE), the word of each, and its class.

    The class of a noun is its place in the alphabet; words that are none of ours come after them. `strange`: of a
    noun's word that nothing is learnt from; `number`: which of its word's drawings it is.
    """

    pictures: NDArray[np.float32]
    words: NDArray[np.str_]
    classes: NDArray[np.int64]
    strange: NDArray[np.bool_]
    number: NDArray[np.int64]

    @property
    def ours(self) -> NDArray[np.bool_]:
        """Those of nouns."""
        return self.classes < len(NOUNS)

    @property
    def to_learn(self) -> NDArray[np.bool_]:
        """Three of four drawings of the words that are learnt from."""
        return ~self.strange & ~self.to_measure

    @property
    def to_measure(self) -> NDArray[np.bool_]:
        """Every fourth drawing, which nothing is learnt from."""
        return np.asarray(self.number % 4 == 2)


def noun_of(word: str) -> str:
    """Return our noun of a word; empty if there is none."""
    name = word.replace(" ", "-")
    return name if name in NOUNS else SYNONYMS.get(name, _ALSO.get(word, ""))


def page_of(strokes: list[NDArray[np.float64]]) -> Image.Image:
    """Draw strokes (N, 2) on a page, as the pad does."""
    low, high = (limit(np.concatenate(strokes), axis=0) for limit in (np.min, np.max))
    page = Image.new("L", (_PAGE, _PAGE), 255)
    pen = ImageDraw.Draw(page)
    for stroke in strokes:
        places = (stroke - (low + high) / 2) * (_DRAWN / max(float((high - low).max()), 1e-9)) + _PAGE / 2
        pen.line([(float(x), float(y)) for x, y in places], fill=0, width=_PEN, joint="curve")
    return page


def drawings(path: Path) -> Iterator[list[NDArray[np.float64]]]:
    """Yield the strokes of each drawing of an ndjson file, those of lines that are cut off left out."""
    for row in path.read_text(encoding="utf-8").splitlines()[:_MOST]:
        try:
            strokes = [np.array(each[:2], float).T for each in json.loads(row)["drawing"] if len(each[0]) > 1]
        except ValueError:
            continue
        if strokes:
            yield strokes


def read_people(folder: Path, *, hold_out: bool = False) -> People:
    """Return the drawings of a folder; `hold_out`: learn from none of every fourth word."""
    rows: list[tuple[NDArray[np.float32], str, int]] = []
    for path in sorted(folder.glob("*.ndjson")):
        rows += [(prepared(page_of(strokes)), path.stem, n) for n, strokes in enumerate(drawings(path))]
    words = np.array([word for _, word, _ in rows], dtype=np.str_)
    every = dict.fromkeys(words.tolist())
    others = [word for word in every if not noun_of(word)]
    places = {name: number for number, name in enumerate([*sorted(NOUNS), *others])}
    ours = [word for word in every if noun_of(word)]
    return People(
        np.stack([each for each, _, _ in rows]),
        words,
        np.array([places[noun_of(word) or word] for word in words.tolist()], np.int64),
        np.isin(words, ours[2::4]) & hold_out,
        np.array([number for _, _, number in rows], np.int64),
    )
