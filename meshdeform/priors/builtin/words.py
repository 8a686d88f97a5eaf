"""Look up the words of the builtin prior, and describe what a prompt means. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from meshdeform.priors.builtin.vocabulary import (
    ADJECTIVE_SYNONYMS,
    ADJECTIVES,
    DEGREE_SYNONYMS,
    FILLERS,
    LENGTH,
    LENGTHWISE,
    NOUN_SYNONYMS,
    NOUNS,
    PART_SYNONYMS,
    PARTS,
    SIZE,
    SIZEWISE,
)

__all__ = [
    "ATTRIBUTES",
    "BUILTIN_WORDS",
    "MAX_ATTRIBUTES",
    "SEQUENCE_LENGTH",
    "Attribute",
    "ParsedPrompt",
    "Words",
    "degree_of",
    "is_adjective",
    "is_known",
    "noun_of",
    "part_of",
    "singular_forms",
]


@dataclass(frozen=True, order=True)
class Attribute:
    """One property: `Attribute("whole", "tall")` of the shape, or `Attribute("neck", "long")` of a part."""

    part: str
    degree: str

    def __str__(self) -> str:
        """Return the attribute as written in a prompt."""
        return self.degree if self.part == "whole" else f"{self.degree} {self.part}"


ATTRIBUTES: tuple[Attribute, ...] = tuple(Attribute("whole", word) for word in ADJECTIVES) + tuple(
    Attribute(part, degree) for part, degrees in PARTS.items() for degree in degrees
)
"""Every attribute, those of the whole shape first."""

MAX_ATTRIBUTES = 3
SEQUENCE_LENGTH = 1 + 2 * MAX_ATTRIBUTES
"""Tokens of a prompt: the noun, and two for each attribute."""


@dataclass(frozen=True)
class Words:
    """The words of one file of weights; attributes and parts are those of the grammar.

    Attributes
    ----------
    nouns : mapping of str to tuple of str
        Every noun with the parts whose size a prompt can set. A noun of several words has hyphens: `teddy-bear`.
    synonyms : mapping of str to str
        Other names of nouns.
    tokens : tuple of str
        Tokens in the order of their numbers; 0 is padding.
    """

    nouns: Mapping[str, tuple[str, ...]]
    synonyms: Mapping[str, str]
    tokens: tuple[str, ...]


BUILTIN_WORDS = Words(
    NOUNS,
    NOUN_SYNONYMS,
    ("<pad>", *NOUNS, *dict.fromkeys([*ADJECTIVES, *LENGTH, *SIZE]), "whole", *PARTS),
)
"""The words of the weights in the package."""


@dataclass(frozen=True)
class ParsedPrompt:
    """Noun and attributes of a prompt."""

    noun: str
    attributes: tuple[Attribute, ...] = ()

    @property
    def tokens(self) -> tuple[str, ...]:
        """Canonical words: the noun, then (degree, part) of each attribute."""
        return (self.noun, *(word for attribute in self.attributes for word in (attribute.degree, attribute.part)))

    def __str__(self) -> str:
        """Return an English prompt with this meaning."""
        whole = [attribute.degree for attribute in self.attributes if attribute.part == "whole"]
        parts = [attribute for attribute in self.attributes if attribute.part != "whole"]
        front = " ".join([*whole, self.noun.replace("-", " ")])
        article = "an" if front[0] in "aeiou" else "a"
        clauses = [f"{a.degree} {a.part}" if a.part.endswith("s") else f"a {a.degree} {a.part}" for a in parts]
        return f"{article} {front}" + (f" with {' and '.join(clauses)}" if clauses else "")


def singular_forms(word: str) -> list[str]:
    """Return the word and its possible singular forms."""
    forms = [word]
    if word.endswith("ies"):
        forms.append(word[:-3] + "y")
    if word.endswith("es"):
        forms.append(word[:-2])
    if word.endswith("s"):
        forms.append(word[:-1])
    return forms


def noun_of(word: str, words: Words = BUILTIN_WORDS) -> str | None:
    """Return the canonical noun of a word, its plural or a synonym, or None."""
    irregular = {"snowmen": "snowman", "cacti": "cactus", "octopi": "octopus"}
    for form in singular_forms(irregular.get(word, word)):
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
    return word in ADJECTIVES or word in ADJECTIVE_SYNONYMS or word in DEGREE_SYNONYMS


def is_known(word: str, words: Words = BUILTIN_WORDS) -> bool:
    """Return whether a word has a role in the grammar."""
    return word in FILLERS or is_adjective(word) or part_of(word) is not None or noun_of(word, words) is not None
