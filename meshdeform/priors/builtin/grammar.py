"""Parse prompts of the builtin prior.

::

    prompt     = [article] {adjective} noun {("with" | "and" | ",") [article] degree part}
    adjective  = tall | short | thin | fat | wide | long | flat | twisted | leaning | bent | tapered |
                 pinched
    degree     = long | short | big | small          part = neck | legs | head | ...

Every noun takes every adjective; `NOUNS` lists the parts of each noun. Synonyms, plurals, capitals and articles are
accepted. Anything else is an error that lists the accepted words, because a prior must not silently ignore half of a
prompt.

Needs neither torch nor numpy: the service checks a prompt before it accepts the job.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass

from meshdeform.errors import PromptError, VocabularyError
from meshdeform.priors.builtin.vocabulary import (
    ADJECTIVE_SYNONYMS,
    ADJECTIVES,
    DEGREE_SYNONYMS,
    FILLERS,
    LENGTH,
    LENGTHWISE,
    NOUN_SYNONYMS,
    NOUNS,
    OPPOSITES,
    PART_SYNONYMS,
    PARTS,
    SIZE,
    SIZEWISE,
)

__all__ = [
    "ADJECTIVES",
    "ATTRIBUTES",
    "MAX_ATTRIBUTES",
    "NOUNS",
    "OPPOSITES",
    "PARTS",
    "SEQUENCE_LENGTH",
    "VOCABULARY",
    "Attribute",
    "ParsedPrompt",
    "parse",
    "parse_negative",
    "tokenise",
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
_PAD = "<pad>"
VOCABULARY: tuple[str, ...] = (
    _PAD,
    *NOUNS,
    *dict.fromkeys([*ADJECTIVES, *LENGTH, *SIZE]),
    "whole",
    *PARTS,
)
"""Tokens in the order of their numbers; 0 is padding."""

_NUMBER = {word: number for number, word in enumerate(VOCABULARY)}


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
        front = " ".join([*whole, self.noun])
        article = "an" if front[0] in "aeiou" else "a"
        clauses = [f"{a.degree} {a.part}" if a.part.endswith("s") else f"a {a.degree} {a.part}" for a in parts]
        return f"{article} {front}" + (f" with {' and '.join(clauses)}" if clauses else "")


def _singular(word: str) -> list[str]:
    """Return the word and its possible singular forms."""
    forms = [word]
    if word.endswith("ies"):
        forms.append(word[:-3] + "y")
    if word.endswith("es"):
        forms.append(word[:-2])
    if word.endswith("s"):
        forms.append(word[:-1])
    return forms


def _noun(word: str) -> str | None:
    irregular = {"snowmen": "snowman", "cacti": "cactus", "octopi": "octopus"}
    for form in _singular(irregular.get(word, word)):
        canonical = NOUN_SYNONYMS.get(form, form)
        if canonical in NOUNS:
            return canonical
    return None


def _part(word: str) -> str | None:
    canonical = PART_SYNONYMS.get(word, word)
    if canonical in PARTS:
        return canonical
    return canonical + "s" if canonical + "s" in PARTS else None


def _degree(word: str, part: str) -> str | None:
    """Return the canonical degree that an adjective means for a part, or None."""
    degree = DEGREE_SYNONYMS.get(word)
    if degree is None:
        return None
    return (LENGTHWISE if PARTS[part] == LENGTH else SIZEWISE).get(degree, degree)


def _refuse(detail: str, unknown: list[str]) -> VocabularyError:
    """Return an error that lists the vocabulary of the prior."""
    nouns = sorted(NOUNS)
    attributes = [*ADJECTIVES, *(f"{low}/{high} {part}" for part, (low, high) in PARTS.items())]
    known = [*nouns, *NOUN_SYNONYMS, *ADJECTIVES, *ADJECTIVE_SYNONYMS, *PARTS, *DEGREE_SYNONYMS]
    strange = [word for word in unknown if word not in known]
    close = {word: match[0] for word in strange if (match := difflib.get_close_matches(word, known, 1, 0.7))}
    hint = "".join(f" Did you mean {match!r} instead of {word!r}?" for word, match in close.items())
    return VocabularyError(
        f"{detail}{hint}",
        advice=(
            f"The builtin demonstration prior knows these nouns: {', '.join(nouns)}; "
            f"and these attributes: {', '.join(attributes)}. For any other prompt choose a Stable Diffusion model: "
            'set model to its hub id or folder (install the "sd" extra on the worker).'
        ),
        unknown=unknown,
        suggestions=close,
        nouns=nouns,
        attributes=attributes,
    )


def parse(prompt: str) -> ParsedPrompt:
    """Parse a prompt of the builtin prior.

    Parameters
    ----------
    prompt : str
        For example "a tall, thin vase" or "a Giraffe with a long neck and short legs".

    Returns
    -------
    ParsedPrompt
        Canonical noun and attributes, equal for prompts with the same meaning.

    Raises
    ------
    PromptError
        The prompt is empty or has more than three attributes.
    VocabularyError
        A word, a part or a combination is not supported; carries `unknown`, `suggestions`, `nouns` and `attributes`.
    """
    return _assemble(*_read(prompt))


def parse_negative(negative: str, prompt: str) -> ParsedPrompt:
    """Parse a negative prompt of the builtin prior.

    Parameters
    ----------
    negative : str
        A prompt ("a chair"), or only attributes ("fat", "a long neck"), which apply to the prompt's noun.
    prompt : str
        The prompt that it accompanies.

    Raises
    ------
    PromptError
        As `parse`; or the negative prompt means the same as the prompt.
    VocabularyError
        As `parse`.
    """
    wanted = parse(prompt)
    nouns, whole, parts = _read(negative)
    unwanted = _assemble(nouns or [wanted.noun], whole, parts)
    if unwanted == wanted:
        raise PromptError(
            f"The negative prompt {negative!r} says the same as the prompt {prompt!r}.",
            advice="Remove from one what is in the other.",
        )
    return unwanted


def _read(prompt: str) -> tuple[list[str], list[str], list[tuple[str, list[str]]]]:
    """Return nouns, adjectives of the whole, and parts with their adjectives, in the order of the prompt."""
    words = re.findall(r"[^\W_]+(?:'[^\W_]+)?", prompt.lower())
    if not words:
        raise PromptError("The prompt is empty.", advice="Name a thing, for example: a tall vase.")
    nouns: list[str] = []
    pending: list[str] = []
    whole: list[str] = []
    parts: list[tuple[str, list[str]]] = []
    unknown: list[str] = []
    for word in words:
        if word in FILLERS:
            continue
        part = _part(word)
        noun = _noun(word)
        if part is not None and (nouns or noun is None):
            parts.append((part, pending))
            pending = []
        elif noun is not None:
            nouns.append(noun)
            whole += pending
            pending = []
        elif word in ADJECTIVES or word in ADJECTIVE_SYNONYMS or word in DEGREE_SYNONYMS:
            pending.append(word)
        else:
            unknown.append(word)
    if unknown:
        raise _refuse(f"The builtin demonstration prior does not know {', '.join(map(repr, unknown))}.", unknown)
    whole += pending  # "a vase, tall and thin"
    return nouns, whole, parts


def _assemble(nouns: list[str], whole: list[str], parts: list[tuple[str, list[str]]]) -> ParsedPrompt:
    """Check that known words fit together, and put them in canonical order."""
    if len(set(nouns)) != 1:
        found = f"it names {len(set(nouns))}: {', '.join(dict.fromkeys(nouns))}" if nouns else "it names none"
        raise _refuse(f"The builtin demonstration prior needs exactly one thing to make, and {found}.", [])
    noun = nouns[0]
    found_attributes: list[Attribute] = []
    for word in whole:
        degree = word if word in ADJECTIVES else ADJECTIVE_SYNONYMS.get(word)
        if degree is None:
            raise _refuse(f"{word!r} says nothing about a shape that is scaled to fit its frame.", [word])
        found_attributes.append(Attribute("whole", degree))
    for part, words in parts:
        if part not in NOUNS[noun]:
            own = ", ".join(NOUNS[noun]) or "none"
            raise _refuse(f"A {noun} of the builtin prior has no {part} to size (its parts: {own}).", [part])
        degrees = {_degree(word, part) for word in words}
        if len(degrees) != 1 or None in degrees:
            low, high = PARTS[part]
            raise _refuse(f"Say either {low!r} or {high!r} of the {part}.", [*words, part])
        found_attributes += [Attribute(part, degree) for degree in degrees if degree is not None]
    unique = sorted(set(found_attributes), key=ATTRIBUTES.index)
    per_part = [attribute.part for attribute in unique if attribute.part != "whole"]
    if len(per_part) != len(set(per_part)):
        raise _refuse("The prompt asks for opposite sizes of one part.", [])
    of_whole = {attribute.degree for attribute in unique if attribute.part == "whole"}
    clash = next((pair for pair in OPPOSITES if pair <= of_whole), None)
    if clash:
        raise _refuse(f"Nothing is {' and '.join(sorted(clash))} at once.", [])
    if len(unique) > MAX_ATTRIBUTES:
        raise PromptError(
            f"The builtin demonstration prior takes at most {MAX_ATTRIBUTES} attributes, the prompt has {len(unique)}.",
            advice="Leave some of them out.",
        )
    return ParsedPrompt(noun, tuple(unique))


def tokenise(parsed: ParsedPrompt) -> list[int]:
    """Return the `SEQUENCE_LENGTH` token numbers of a parsed prompt, padded with 0."""
    numbers = [_NUMBER[word] for word in parsed.tokens]
    return numbers + [0] * (SEQUENCE_LENGTH - len(numbers))
