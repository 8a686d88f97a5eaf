"""Bring a sentence into words that are known: out of German or Spanish, and misspelt ones. Pure Python.

A sentence is translated, word by word, if a word of the other language says what is to change or how much: "größerer
Kopf" is, and "a bigger Hut" is not. What a table lacks stays, as it may be the name of a part of the file. A word of
five letters or more that is one letter off from one for a change is taken for it, unless it is an English noun.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from meshdeform.plain.vocabulary import (
    ADJECTIVES,
    COMMANDS,
    COUNT,
    FILLERS,
    FRACTION,
    LESS,
    MEASURES,
    MORE,
    PART_OF,
    SIDES,
    SLIGHT,
    STRONG,
    TIMES,
    UNITS,
    VERBS,
    adjective,
    singular,
)
from meshdeform.vocabulary.near_words import is_noun
from meshdeform.vocabulary.translation import LANGUAGES, english_of

_OWN = Path(__file__).with_name("translations.txt")
_JOINING = frozenset(
    {"and", "but", "with", "then", "little", "too", "not", "less", "times", "x", "percent", "per", "cent"}
)
_LETTERS = 5
"""Letters from which a word may be misspelt: of shorter ones, too many are one letter apart."""


def in_known_words(text: str, noun_of: Callable[[str], str | None]) -> tuple[str, tuple[str, ...]]:
    """Return a text, in small letters, in known words as far as there are any, and a sentence for each misspelt one."""
    words = list(dict.fromkeys(re.findall(r"[^\W\d_]+", text)))

    def known(word: str) -> bool:
        return _is_known(word) or noun_of(word) is not None

    if all(map(known, words)):
        return text, ()
    english = _english(words, known)
    text = re.sub(r"[^\W\d_]+", lambda found: english.get(found[0], found[0]), text)
    meant = {
        word: correction
        for word in words
        if word not in english and not known(word) and (correction := _correction(word)) is not None
    }
    text = re.sub(r"[^\W\d_]+", lambda found: meant.get(found[0], found[0]), text)
    return text, tuple(f"{word!r} was read as {correction!r}." for word, correction in meant.items())


def says_change(text: str, noun_of: Callable[[str], str | None]) -> bool:
    """Return whether a sentence compares or commands, as no name of a thing does."""
    known, _ = in_known_words(text.lower(), noun_of)
    words = re.findall(r"[^\W\d_]+", known)
    found = [adjective(word) for word in words]
    commands = {"too", *MORE, *LESS, *COMMANDS}
    return any(each is not None and each[2] for each in found) or bool(commands & set(words))


def _is_known(word: str) -> bool:
    tables = (FILLERS, SIDES, SLIGHT, STRONG, MORE, LESS, MEASURES, TIMES, COUNT, FRACTION, UNITS, _JOINING)
    return any(word in table for table in tables) or adjective(word) is not None or singular(word) in PART_OF


def _english(words: list[str], known: Callable[[str], bool]) -> dict[str, str]:
    """Return the English word of each word, of the language that knows the most of them; none of an English text."""
    readings = []
    for language in range(LANGUAGES):
        found = {word: english for word in words if (english := _english_word(word, language)) is not None}
        # "los" and "die" mean something in English sentences as well.
        if any(_says_change(english) and not known(word) for word, english in found.items()):
            readings.append(found)
    return max(readings, key=len, default={})


def _english_word(word: str, language: int) -> str | None:
    return english_of(word, language, _OWN) or english_of(word, language)


def _says_change(english: str) -> bool:
    words = {"more", "less", "slightly", "much", "too", *TIMES, *MORE, *LESS, *MEASURES}
    return english in words or adjective(english) is not None


def _correction(word: str) -> str | None:
    """Return the one word for a change that is a letter off from a misspelt one."""
    if len(word) < _LETTERS or is_noun(word) or is_noun(singular(word)):
        return None
    near = [each for each in _words_for_changes() if is_one_edit_apart(word, each)]
    meanings = {adjective(each) for each in near}
    return near[0] if len({meaning and meaning[:2] for meaning in meanings}) == 1 else None


@lru_cache(maxsize=1)
def _words_for_changes() -> tuple[str, ...]:
    formed = (
        form for word in ADJECTIVES for form in (f"{word}er", f"{word}{word[-1]}er", f"{word}r", f"{word[:-1]}ier")
    )
    compared = [form for form in formed if adjective(form) is not None]
    return tuple(dict.fromkeys([*compared, *VERBS, *ADJECTIVES]))


def is_one_edit_apart(one: str, other: str) -> bool:
    """Return whether two words differ by a letter more, less or another, or by two that are swapped."""
    if abs(len(one) - len(other)) > 1 or one == other:
        return False
    start = 0
    while start < min(len(one), len(other)) and one[start] == other[start]:
        start += 1
    a, b = one[start:], other[start:]
    return a[1:] == b[1:] or a[1:] == b or a == b[1:] or (a[:2] == b[1::-1] and a[2:] == b[2:])
