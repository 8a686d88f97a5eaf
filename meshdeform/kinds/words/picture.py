"""Draw a word of one's own."""

from __future__ import annotations

from meshdeform.runs.sheets import family_png, shown
from meshdeform.words import Word

__all__ = ["word_png"]


def word_png(word: Word) -> bytes:
    """Return a PNG of the shapes of a word, coloured by their parts; of many, some."""
    some = [word.shapes[number] for number in shown(len(word.shapes))]
    names = [*word.parts, *(["no part"] if any((shape.labels < 0).any() for shape in some) else [])]
    return family_png([(shape.verts, shape.faces, (shape.labels % len(names)).astype("u1")) for shape in some], names)
