"""Find known words near an unknown one: spelled alike, or of similar meaning.

Known words that are spelled alike come first, if the word is not a noun itself; then nouns that look alike; then nouns
of similar meaning. The nearest nouns of every English word for a thing are in `near_nouns.txt.gz`, made by
`release/nouns.py` (WordNet and a sentence encoder; WordNet's licence is at its head).
"""

from __future__ import annotations

import difflib
import gzip
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from meshdeform.vocabulary.lookup import WORDS, Words, singular_forms
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from meshdeform.vocabulary.words import ADJECTIVE_SYNONYMS, ADJECTIVES, DEGREE_SYNONYMS, PART_SYNONYMS

MAX_SUGGESTIONS = 3
_SIMILARITY = 0.79
_MIN_LENGTH = 3


def correct(unknown: Iterable[str], *, with_nouns: bool, words: Words = WORDS) -> dict[str, str]:
    """Return the known word in place of each misspelt one.

    `with_nouns`: whether nouns count: a prompt that has one needs no second; `words`: the words that the model knows.
    """
    vocabulary = [*ADJECTIVES, *ADJECTIVE_SYNONYMS, *PARTS, *PART_SYNONYMS, *DEGREE_SYNONYMS]
    if with_nouns:
        vocabulary += [*words.nouns, *words.synonyms]
    return {
        word: match[0]
        for word in unknown
        if len(word) >= _MIN_LENGTH and not is_english_noun(word) and (match := _closest(word, tuple(vocabulary)))
    }


@lru_cache(maxsize=256)
def _closest(word: str, vocabulary: tuple[str, ...]) -> list[str]:
    """Return the known word that a word looks like, if any: sought for a millisecond, and often for the same word."""
    return difflib.get_close_matches(word, vocabulary, 1, _SIMILARITY)


def is_english_noun(word: str) -> bool:
    """Return whether a word is a noun of English, spelled correctly: a boot is no misspelt boat."""
    return any(map(is_noun, singular_forms(word)))


def nearest_nouns(word: str, words: Words = WORDS) -> list[str]:
    """Return up to three known nouns that look like what a word names, or mean something similar."""
    return next(filter(None, (nearest(form, words.nouns) for form in singular_forms(word))), [])


@lru_cache(maxsize=1)
def _near() -> dict[str, list[str]]:
    """Return every English word for a thing with the builtin nouns nearest to it, which may be none."""
    text = gzip.decompress((Path(__file__).parent / "near_nouns.txt.gz").read_bytes()).decode()
    rows = (line.partition(":") for line in text.splitlines() if not line.startswith("#"))
    return {word: nouns.split() for nouns, _, words in rows for word in words.split()}


def is_noun(word: str) -> bool:
    """Return whether a word, in small letters and singular, is English for a thing."""
    return word in _near()


def nearest(word: str, nouns: Iterable[str]) -> list[str]:
    """Return up to three nouns whose meaning is nearest to that of a word, nearest first.

    `word`: in small letters, singular. `nouns`: the nouns to choose from. One that is not builtin counts as near if the
    two have two neighbours in common. Empty if the word is not
    known, or near to none of the nouns.
    """
    table = _near()
    around = table.get(word, [])
    own = [noun for noun in nouns if noun not in NOUNS and len({*around} & {*table.get(noun, [])}) > 1]
    return [*own, *(noun for noun in around if noun in nouns)][:MAX_SUGGESTIONS]
