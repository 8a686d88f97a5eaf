"""Choose the words in use whose shapes are roughly like an asset, so that it is compared in full with few of many."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.labels import Floats, Index
from meshdeform.words.file import Word
from meshdeform.words.in_use import words_in_use

__all__ = ["MOST_COMPARED", "words_near"]

MOST_COMPARED = 8
"""Words with which an asset is compared in full."""
_SHAPES = 8
"""Shapes of a word that count here; of more, the first."""
_BINS = 8


def words_near(points: Floats, faces: Index) -> tuple[Word, ...]:
    """Return at most `MOST_COMPARED` of the words in use: those nearest to a mesh (V, 3), (F, 3) with +Y up."""
    words = words_in_use()
    if len(words) <= MOST_COMPARED:
        return words
    own = _described(points, faces)
    apart = [
        min(float(np.abs(own - _described(each.verts, each.faces)).sum()) for each in word.shapes[:_SHAPES])
        for word in words
    ]
    nearest = sorted(np.argsort(apart, kind="stable")[:MOST_COMPARED].tolist())
    return tuple(words[number] for number in nearest)


def _described(points: Floats, faces: Index) -> Floats:
    """Return numbers (3 + 2 `_BINS`,) that a quarter turn about +Y leaves as they are.

    They are the sides of the box by its diagonal, and how the area is spread over the height and away from the axis.
    """
    a, b, c = points[faces].transpose(1, 0, 2)
    low, high = (bound([a.T, b.T, c.T], axis=(0, 2)) for bound in (np.min, np.max))
    sides = (high - low) / max(float(np.linalg.norm(high - low)), 1e-300)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    centres = ((a + b + c) / 3 - (low + high) / 2) / np.maximum(high - low, 1e-300)
    away = np.linalg.norm(centres[:, [0, 2]], axis=1) / np.sqrt(0.5)
    spread = [
        np.histogram(values, _BINS, (0, 1), weights=areas / max(float(areas.sum()), 1e-300))[0]
        for values in (centres[:, 1] + 0.5, away)
    ]
    return np.concatenate([[sides[1]], np.sort(sides[[0, 2]]), *spread])
