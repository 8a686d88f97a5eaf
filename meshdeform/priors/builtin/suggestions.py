"""Suggest prompts of the builtin prior in place of one that it refuses. Torch-free.

For an unknown word come first the known words that are spelled alike, if the word is not a noun itself; then nouns that
look alike; then nouns of similar meaning (`meaning.py`).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from meshdeform.priors.builtin.meaning import is_noun, nearest
from meshdeform.priors.builtin.vocabulary import (
    ADJECTIVE_SYNONYMS,
    ADJECTIVES,
    DEGREE_SYNONYMS,
    OPPOSITES,
    PART_SYNONYMS,
    PARTS,
)
from meshdeform.priors.builtin.words import (
    ATTRIBUTES,
    BUILTIN_WORDS,
    MAX_ATTRIBUTES,
    Attribute,
    ParsedPrompt,
    Words,
    degree_of,
    noun_of,
    singular_forms,
)

__all__ = ["MAX_SUGGESTIONS", "Suggestions", "correct", "nearest_nouns", "suggest"]

MAX_SUGGESTIONS = 3
_SIMILARITY = 0.79
_MIN_LENGTH = 4
_POPULAR = ("mushroom", "vase", "rabbit")

# Frequent prompts, and the nouns that look most like them.
_RELATED = {
    "airplane": "glider drone",
    "apple": "fruit orange peach cherry",
    "armchair": "throne",
    "bird": "dove hawk",
    "boat": "canoe kayak",
    "bottle": "jar",
    "bowl": "mug",
    "bucket": "basket pot",
    "cat": "fox",
    "church": "temple mosque",
    "crocodile": "lizard",
    "dog": "wolf",
    "dragon": "monster",
    "fish": "salmon",
    "flower": "plant",
    "goblet": "glass trophy",
    "horse": "donkey zebra unicorn",
    "house": "barn",
    "lamp": "lantern",
    "lion": "tiger leopard panther",
    "mouse": "squirrel hamster",
    "octopus": "squid jellyfish",
    "person": "wizard knight soldier",
    "rabbit": "kangaroo",
    "rocket": "ufo satellite",
    "sheep": "goat",
    "skyscraper": "building",
    "snowman": "gnome",
    "teapot": "teacup",
    "tree": "bush",
    "truck": "van",
    "vase": "jug pitcher",
    "whale": "seal",
}
_NOUN_OF_RELATED = {word: noun for noun, words in _RELATED.items() for word in words.split()}


@dataclass(frozen=True)
class Suggestions:
    """What to say in place of a refused prompt.

    Attributes
    ----------
    prompts : list of str
        One to three prompts that are accepted and keep what was understood.
    corrections : dict of str to str
        The known word in place of each misspelt one.
    nearest : dict of str to list of str
        By unknown word, known nouns that look like it or mean something similar; nearest first.
    near : bool
        Whether the prompts come from the refused one, and are not merely examples.
    """

    prompts: list[str]
    corrections: dict[str, str]
    nearest: dict[str, list[str]]
    near: bool


def correct(unknown: Iterable[str], *, with_nouns: bool, words: Words = BUILTIN_WORDS) -> dict[str, str]:
    """Return the known word in place of each misspelt one.

    Parameters
    ----------
    with_nouns : bool
        Whether nouns count: a prompt that has one needs no second.
    words : Words
        The words that the model knows.
    """
    known = [*ADJECTIVES, *ADJECTIVE_SYNONYMS, *PARTS, *PART_SYNONYMS, *DEGREE_SYNONYMS]
    if with_nouns:
        known += [*words.nouns, *words.synonyms]
    return {
        word: match[0]
        for word in unknown
        if len(word) >= _MIN_LENGTH
        and not _is_word(word)
        and (match := difflib.get_close_matches(word, known, 1, _SIMILARITY))
    }


def _is_word(word: str) -> bool:
    """Return whether a word is a noun of English, spelled correctly: a boot is no misspelt boat."""
    return any(form in _NOUN_OF_RELATED or is_noun(form) for form in singular_forms(word))


def nearest_nouns(word: str, words: Words = BUILTIN_WORDS) -> list[str]:
    """Return up to three known nouns that look like what a word names, or mean something similar."""
    for form in singular_forms(word):
        looks_like = [_NOUN_OF_RELATED[form]] if _NOUN_OF_RELATED.get(form) in words.nouns else []
        if found := list(dict.fromkeys([*looks_like, *nearest(form, words.nouns)])):
            return found[:MAX_SUGGESTIONS]
    return []


def suggest(
    nouns: Sequence[str],
    whole: Sequence[str],
    parts: Sequence[tuple[str, Sequence[str]]],
    unknown: Sequence[str],
    words: Words = BUILTIN_WORDS,
) -> Suggestions:
    """Return what to say in place of a refused prompt.

    Parameters
    ----------
    nouns : sequence of str
        Canonical nouns of the refused prompt.
    whole : sequence of str
        Adjectives of the whole.
    parts : sequence of tuple
        Canonical parts with their adjectives.
    unknown : sequence of str
        Words that were not understood.
    words : Words
        The words that the model knows.
    """
    corrections = correct(unknown, with_nouns=not nouns, words=words)
    corrected = list(corrections.values())
    whole = [*whole, *(word for word in corrected if word in ADJECTIVES or word in ADJECTIVE_SYNONYMS)]
    chosen = list(nouns) or [noun for word in corrected if (noun := noun_of(word, words))]
    near: dict[str, list[str]] = {}
    if not chosen:
        near = {word: found for word in unknown if word not in corrections and (found := nearest_nouns(word, words))}
        chosen = [noun for found in near.values() for noun in found]
    prompts: list[str] = []
    for noun in dict.fromkeys(chosen or [noun for noun in _POPULAR if noun in words.nouns] or words.nouns):
        candidates = [*_of_whole(whole), *_of_parts(noun, parts, words)]
        # The first of two attributes that contradict each other, or the last.
        prompts += [str(_fitted(noun, order)) for order in (candidates, candidates[::-1])]
    meant = bool(unknown and chosen)
    return Suggestions(list(dict.fromkeys(prompts))[:MAX_SUGGESTIONS], corrections, near, meant)


def _of_whole(words: Iterable[str]) -> list[Attribute]:
    degrees = (word if word in ADJECTIVES else ADJECTIVE_SYNONYMS.get(word) for word in words)
    return [Attribute("whole", degree) for degree in degrees if degree is not None]


def _of_parts(noun: str, parts: Iterable[tuple[str, Sequence[str]]], words: Words) -> list[Attribute]:
    found = []
    for part, sizes in parts:
        if part in words.nouns[noun]:
            degrees = [degree for size in sizes if (degree := degree_of(size, part))]
            found += [Attribute(part, degree) for degree in degrees or PARTS[part]]
    return found


def _fitted(noun: str, candidates: Iterable[Attribute]) -> ParsedPrompt:
    """Take each attribute that does not contradict those before it."""
    taken: list[Attribute] = []
    for attribute in candidates:
        of_whole = {other.degree for other in [*taken, attribute] if other.part == "whole"}
        clash = any(pair <= of_whole for pair in OPPOSITES)
        sized = attribute.part != "whole" and any(other.part == attribute.part for other in taken)
        if attribute not in taken and not clash and not sized and len(taken) < MAX_ATTRIBUTES:
            taken.append(attribute)
    return ParsedPrompt(noun, tuple(sorted(taken, key=ATTRIBUTES.index)))
