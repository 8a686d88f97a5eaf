"""A word of a wedge with two parts, and one of a box."""

from __future__ import annotations

import numpy as np

from meshdeform.words import ShapeSource, Word, WordShape, write_word

__all__ = ["BOX", "WEDGE", "box", "word"]

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
_FACES = np.array([each for a, b, c, d in _SIDES for each in ([a, b, c], [a, c, d])])


def box(x: float = 1.0, y: float = 1.0, z: float = 1.0, *, parts: int = 2) -> WordShape:
    """Return a box of these sides; faces on its upper half are of part 0, the others of part 1, or of none."""
    verts = _CORNERS * [x, y, z]
    labels = np.where(verts[_FACES].mean(1)[:, 1] > 0, 0, 1) if parts else np.full(len(_FACES), -1)
    return WordShape(verts / np.linalg.norm(2 * np.array([x, y, z])), _FACES, labels)


def word(noun: str, *shapes: WordShape, **more: object) -> Word:
    """Return a word of shapes whose parts are a head and a body."""
    sources = [ShapeSource(f"{number}.glb", licence="CC0") for number in range(len(shapes))]
    return write_word(noun, shapes, sources, **{"parts": ("head", "body"), **more})  # type: ignore[arg-type]


WEDGE = word("wedge", box(1, 2, 3), box(3, 1, 1), synonyms=("doorstop", "chock"))
BOX = word("dragon-box", box())
