"""Look words up: nouns with their parts, adjectives, degrees, and the properties that they stand for.

Synonyms and plurals are accepted. `using_words` lets a block have further words, such as those of somebody's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from meshdeform.vocabulary.looks import LOOKS, SHAPES
from meshdeform.vocabulary.nouns import LENGTH, NOUNS, PARTS, SYNONYMS
from meshdeform.vocabulary.words import (
    ADJECTIVE_SYNONYMS,
    ADJECTIVES,
    DEGREE_SYNONYMS,
    FILLERS,
    INTENSIFIERS,
    LENGTHWISE,
    PART_SYNONYMS,
    SIZEWISE,
)

_IRREGULAR = {
    "mice": "mouse", "geese": "goose", "teeth": "tooth", "feet": "foot", "oxen": "ox", "people": "person",
    "children": "child",
}  # fmt: skip
_PLURALS = (("ies", "y"), ("ves", "f"), ("ves", "fe"), ("men", "man"), ("es", ""), ("s", ""), ("i", "us"))
"""Endings of plurals with those of their singulars."""


@dataclass(frozen=True, order=True)
class Attribute:
    """One property: `Attribute("whole", "tall")` of the shape, or `Attribute("neck", "long")` of a part."""

    part: str
    degree: str

    def __str__(self) -> str:
        """Return the attribute as written in a prompt."""
        return self.degree if self.part == "whole" else f"{self.degree} {self.part}"


ATTRIBUTES: tuple[Attribute, ...] = tuple(Attribute("whole", word) for word in (*ADJECTIVES, *SHAPES)) + tuple(
    Attribute(part, degree) for part, degrees in PARTS.items() for degree in degrees
)
"""Every attribute, those of the whole shape first."""


@dataclass(frozen=True)
class Words:
    """The words that a prompt may have; attributes and parts are those of the grammar."""

    nouns: Mapping[str, tuple[str, ...]]
    """Every noun with the parts whose size a prompt can set. A noun of several words has hyphens: `teddy-bear`."""
    synonyms: Mapping[str, str]  # other names of nouns
    tokens: tuple[str, ...]  # tokens in the order of their numbers; 0 is padding


WORDS = Words(NOUNS, SYNONYMS, ())
"""The words of all nouns that have shapes."""
_current: ContextVar[Words] = ContextVar("words", default=WORDS)


@contextmanager
def using_words(words: Words) -> Iterator[None]:
    """Let prompts within the block have these words, in place of `WORDS` (`meshdeform.words.in_use`)."""
    token = _current.set(words)
    try:
        yield
    finally:
        _current.reset(token)


def current_words() -> Words:
    """Return the words that prompts may have: those of the package, or of the `using_words` block around."""
    return _current.get()


def singular_forms(word: str) -> list[str]:
    """Return the word and its possible singular forms."""
    formed = [word.removesuffix(plural) + singular for plural, singular in _PLURALS if word.endswith(plural)]
    return [word, *([_IRREGULAR[word]] if word in _IRREGULAR else []), *formed]


def noun_of(word: str, words: Words | None = None) -> str | None:
    """Return the canonical noun of a word, its plural or a synonym, or None; by default of what is known here."""
    words = words or current_words()
    for form in singular_forms(word):
        canonical = form if form in words.nouns else words.synonyms.get(form, form)
        if canonical in words.nouns:
            return canonical
    return None


def part_of(word: str) -> str | None:
    """Return the canonical part of a word or a synonym, or None."""
    canonical = PART_SYNONYMS.get(word, word)
    if canonical in PARTS:
        return canonical
    return canonical + "s" if canonical + "s" in PARTS else None


def degree_of(word: str, part: str) -> str | None:
    """Return the canonical degree that an adjective means for a part, or None."""
    degree = DEGREE_SYNONYMS.get(word)
    if degree is None:
        return None
    return (LENGTHWISE if PARTS[part] == LENGTH else SIZEWISE).get(degree, degree)


def is_adjective(word: str) -> bool:
    """Return whether a word is an adjective of the whole or of a part."""
    return any(word in table for table in (ADJECTIVES, ADJECTIVE_SYNONYMS, DEGREE_SYNONYMS, LOOKS))


def is_known(word: str, words: Words | None = None) -> bool:
    """Return whether a word has a role in the grammar."""
    told = word in FILLERS or word in INTENSIFIERS or is_adjective(word)
    return told or part_of(word) is not None or noun_of(word, words) is not None
