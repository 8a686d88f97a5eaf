"""Of many words, an asset is compared with those that are roughly like it."""

from __future__ import annotations

import numpy as np

from meshdeform.reading.choice import facing
from meshdeform.words import in_use
from meshdeform.words.near import MOST_COMPARED, words_near
from tests.unit.words.words import box, word

SIDES = [(1.0, 1.0 + 0.3 * number, 2.0) for number in range(12)]
WORDS = [word(f"box-{chr(97 + number)}", box(4, 1, 1), box(*sides)) for number, sides in enumerate(SIDES)]


def test_the_nearest_words_are_compared_whichever_way_the_asset_faces_and_whatever_its_size() -> None:
    asset = box(*SIDES[6])
    for turn in (0.0, 90.0, 180.0):
        points = 7 * asset.verts @ facing(turn).T + [3.0, 1.0, 2.0]
        with in_use(WORDS):
            near = words_near(points, asset.faces)
        assert len(near) == MOST_COMPARED
        assert WORDS[6] in near
        assert WORDS[0] not in near


def test_few_words_all_count() -> None:
    flat = np.zeros((3, 3))
    with in_use(WORDS[:MOST_COMPARED]):
        assert words_near(flat, np.array([[0, 1, 2]])) == tuple(WORDS[:MOST_COMPARED])
