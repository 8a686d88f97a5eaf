"""Suggest prompts of the builtin prior in place of one that it refuses. Torch-free."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from meshdeform.priors.builtin.vocabulary import (
    ADJECTIVE_SYNONYMS,
    ADJECTIVES,
    DEGREE_SYNONYMS,
    NOUN_SYNONYMS,
    NOUNS,
    OPPOSITES,
    PART_SYNONYMS,
    PARTS,
)
from meshdeform.priors.builtin.words import ATTRIBUTES, MAX_ATTRIBUTES, Attribute, ParsedPrompt, degree_of, noun_of

__all__ = ["MAX_SUGGESTIONS", "correct", "suggest_prompts"]

MAX_SUGGESTIONS = 3
_SIMILARITY = 0.79
_MIN_LENGTH = 4
_POPULAR = ("mushroom", "vase", "rabbit")

# Frequent prompts, and the nouns that look most like them.
_RELATED = {
    "airplane": "glider helicopter drone",
    "boat": "submarine canoe kayak",
    "bottle": "jar",
    "bowl": "mug pot teapot teacup bucket basket",
    "car": "truck bus van lorry tractor train",
    "cat": "lion tiger fox leopard panther",
    "chair": "stool bench throne",
    "dinosaur": "dragon lizard crocodile monster",
    "dog": "wolf bear",
    "duck": "goose swan chicken eagle parrot owl",
    "fish": "shark salmon",
    "goblet": "glass trophy",
    "horse": "cow sheep goat deer donkey camel zebra unicorn",
    "house": "castle tower church building barn",
    "lamp": "candle lantern",
    "octopus": "squid spider jellyfish",
    "pear": "apple fruit orange",
    "rabbit": "mouse rat squirrel kangaroo",
    "rocket": "ufo satellite",
    "snowman": "man woman person human robot gnome wizard knight soldier boy girl child",
    "tree": "flower plant rose palm bush",
    "turtle": "frog snail crab",
    "vase": "jug pitcher",
    "whale": "dolphin seal",
}
_NOUN_OF_RELATED = {word: noun for noun, words in _RELATED.items() for word in words.split()}


def correct(unknown: Iterable[str], *, with_nouns: bool) -> dict[str, str]:
    """Return the known word in place of each misspelt one.

    Parameters
    ----------
    unknown : iterable of str
    with_nouns : bool
        Whether nouns count: a prompt that has one needs no second.
    """
    known = [*ADJECTIVES, *ADJECTIVE_SYNONYMS, *PARTS, *PART_SYNONYMS, *DEGREE_SYNONYMS]
    if with_nouns:
        known += [*NOUNS, *NOUN_SYNONYMS]
    return {
        word: match[0]
        for word in unknown
        if len(word) >= _MIN_LENGTH
        and word not in _NOUN_OF_RELATED
        and (match := difflib.get_close_matches(word, known, 1, _SIMILARITY))
    }


def suggest_prompts(
    nouns: Sequence[str], whole: Sequence[str], parts: Sequence[tuple[str, Sequence[str]]], unknown: Sequence[str]
) -> list[str]:
    """Return up to three prompts that are accepted and keep what was understood.

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
    """
    corrected = list(correct(unknown, with_nouns=not nouns).values())
    whole = [*whole, *(word for word in corrected if word in ADJECTIVES or word in ADJECTIVE_SYNONYMS)]
    chosen = list(nouns) or [noun for word in corrected if (noun := noun_of(word))]
    if not chosen:
        chosen = [*(_NOUN_OF_RELATED[word] for word in unknown if word in _NOUN_OF_RELATED), *_POPULAR]
    prompts: list[str] = []
    for noun in dict.fromkeys(chosen):
        candidates = [*_of_whole(whole), *_of_parts(noun, parts)]
        # The first of two attributes that contradict each other, or the last.
        prompts += [str(_fitted(noun, order)) for order in (candidates, candidates[::-1])]
    return list(dict.fromkeys(prompts))[:MAX_SUGGESTIONS]


def _of_whole(words: Iterable[str]) -> list[Attribute]:
    degrees = (word if word in ADJECTIVES else ADJECTIVE_SYNONYMS.get(word) for word in words)
    return [Attribute("whole", degree) for degree in degrees if degree is not None]


def _of_parts(noun: str, parts: Iterable[tuple[str, Sequence[str]]]) -> list[Attribute]:
    found = []
    for part, words in parts:
        if part in NOUNS[noun]:
            degrees = [degree for word in words if (degree := degree_of(word, part))]
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
