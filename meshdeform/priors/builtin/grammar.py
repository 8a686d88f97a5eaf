"""Parse prompts of the builtin prior.

::

    prompt     = [article] {adjective} noun {("with" | "and" | ",") [article] degree part}
    adjective  = tall | short | thin | fat | wide | long | flat | twisted | leaning | bent | tapered |
                 pinched
    degree     = long | short | big | small          part = neck | legs | head | ...

Every noun takes every adjective; `NOUNS` lists the parts of each noun. Synonyms, plurals, capitals and articles are
accepted. Anything else is an error that suggests prompts: ignoring half of a prompt silently would be worse.

Needs neither torch nor numpy: the service checks a prompt before it accepts the job.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import zip_longest

from meshdeform.errors import PromptError, VocabularyError
from meshdeform.priors.builtin.suggestions import suggest
from meshdeform.priors.builtin.vocabulary import (
    ADJECTIVE_SYNONYMS,
    ADJECTIVES,
    FILLERS,
    NOUNS,
    OPPOSITES,
    PARTS,
)
from meshdeform.priors.builtin.words import (
    ATTRIBUTES,
    BUILTIN_WORDS,
    MAX_ATTRIBUTES,
    SEQUENCE_LENGTH,
    Attribute,
    ParsedPrompt,
    Words,
    degree_of,
    is_adjective,
    is_known,
    noun_of,
    part_of,
)

__all__ = [
    "ADJECTIVES",
    "ATTRIBUTES",
    "BUILTIN_WORDS",
    "MAX_ATTRIBUTES",
    "NOUNS",
    "OPPOSITES",
    "PARTS",
    "SEQUENCE_LENGTH",
    "VOCABULARY",
    "Attribute",
    "ParsedPrompt",
    "Words",
    "parse",
    "parse_negative",
    "tokenise",
    "variations",
]


VOCABULARY = BUILTIN_WORDS.tokens
"""Tokens of the weights in the package, in the order of their numbers."""

_PROPORTIONS = ("tall", "wide", "thin", "fat", "short", "long")
_FREE_TEXT = "Free text needs a Stable Diffusion model (params.guidance.model)."
_OWN_WORDS = 5


def _advice(known: Words) -> str:
    """Return where all words are listed; of taught weights, name those of their own as well."""
    if known == BUILTIN_WORDS:
        return f"All words: meshdeform models builtin, or GET /v1/models. {_FREE_TEXT}"
    own = [noun for noun in known.nouns if noun not in NOUNS]
    taught = ""
    if own:
        more = ", and others" if len(own) > _OWN_WORDS else ""
        # The last ones were taught last.
        taught = f"It was taught: {', '.join(reversed(own[-_OWN_WORDS:]))}{more}. "
    return (
        f"{taught}All words of these weights: meshdeform models FILE, with their file, or GET /v1/models. {_FREE_TEXT}"
    )


_Parts = list[tuple[str, list[str]]]


@dataclass(frozen=True)
class _Reading:
    """The words of a prompt by their role, in order, and the words that the model knows."""

    known: Words
    words: list[str]
    nouns: list[str]
    whole: list[str]
    parts: _Parts
    unknown: list[str]

    def refusal(self, detail: str, unknown: list[str]) -> VocabularyError:
        """Return an error with whole prompts that work instead, and with the vocabulary as data."""
        found = suggest(self.nouns, self.whole, self.parts, self.unknown, self.known)
        offer = (
            f"Did you mean {_listed(found.prompts, 'or')}?" if found.near else f"Try {_listed(found.prompts, 'or')}."
        )
        return VocabularyError(
            detail,
            advice=f"{offer} {_advice(self.known)}",
            unknown=unknown,
            suggestions=found.prompts,
            corrections=found.corrections,
            nearest=found.nearest,
            nouns=sorted(self.known.nouns),
            attributes=[*ADJECTIVES, *(f"{low}/{high} {part}" for part, (low, high) in PARTS.items())],
        )


def _listed(items: Iterable[str], conjunction: str) -> str:
    quoted = [repr(item) for item in items]
    return f" {conjunction} ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))


def parse(prompt: str, known: Words = BUILTIN_WORDS) -> ParsedPrompt:
    """Parse a prompt of the builtin prior.

    Parameters
    ----------
    prompt : str
        For example "a tall, thin vase" or "a Giraffe with a long neck and short legs".
    known : Words
        The words of the file of weights; by default those in the package.

    Returns
    -------
    ParsedPrompt
        Canonical noun and attributes, equal for prompts with the same meaning.

    Raises
    ------
    PromptError
        The prompt is empty or has more than three attributes.
    VocabularyError
        A word, a part or a combination is not supported. Its extras: `unknown` (words), `suggestions` (up to three
        prompts that are accepted), `corrections` (of misspelt words), `nearest` (known nouns of similar meaning, by
        unknown word), `nouns` and `attributes`.
    """
    return _assemble(_read(prompt, known))


def variations(prompt: str, count: int, known: Words = BUILTIN_WORDS) -> list[str]:
    """Return prompts of different members of what a prompt allows: itself, then each time with one attribute more.

    Another seed alone hardly changes a result, since few controls leave little to chance. Parts become longer or
    bigger first, in turns with the proportions of the whole; what a prompt says already is not contradicted. Beyond the
    last attribute the prompt itself is repeated, as is one with as many attributes as fit.

    Raises
    ------
    PromptError, VocabularyError
        As `parse`.
    """
    meant = parse(prompt, known)
    said = {attribute.part for attribute in meant.attributes}
    parts = [part for part in known.nouns[meant.noun] if part not in said]
    sized = [Attribute(part, degree) for high in (1, 0) for part in parts for degree in [PARTS[part][high]]]
    shaped = [] if "whole" in said else [Attribute("whole", word) for word in _PROPORTIONS]
    pairs = zip_longest(sized, shaped)
    further = [attribute for pair in pairs for attribute in pair if attribute is not None]
    if len(meant.attributes) >= MAX_ATTRIBUTES:
        further = []
    more = [str(replace(meant, attributes=_ordered([*meant.attributes, attribute]))) for attribute in further]
    return [prompt, *more, *[prompt] * count][:count]


def _ordered(attributes: Iterable[Attribute]) -> tuple[Attribute, ...]:
    return tuple(sorted(set(attributes), key=ATTRIBUTES.index))


def parse_negative(negative: str, prompt: str, known: Words = BUILTIN_WORDS) -> ParsedPrompt:
    """Parse a negative prompt of the builtin prior.

    Parameters
    ----------
    negative : str
        A prompt ("a chair"), or only attributes ("fat", "a long neck"), which apply to the prompt's noun.
    prompt : str
        The prompt that it accompanies.
    known : Words
        As in `parse`.

    Raises
    ------
    PromptError
        As `parse`; or the negative prompt means the same as the prompt.
    VocabularyError
        As `parse`, but without suggestions, which are for prompts.
    """
    wanted = parse(prompt, known)
    try:
        reading = _read(negative, known)
        unwanted = _assemble(replace(reading, nouns=reading.nouns or [wanted.noun]))
    except VocabularyError as error:
        extra = {**error.extra, "suggestions": [], "nearest": {}}
        raise VocabularyError(f"In the negative prompt: {error.detail}", advice=_advice(known), **extra) from error
    if unwanted == wanted:
        raise PromptError(
            f"The negative prompt {negative!r} means the same as the prompt {prompt!r}.",
            advice="Remove from one what is in the other.",
        )
    return unwanted


def _read(prompt: str, known: Words) -> _Reading:
    """Return the words of a prompt by their role; unknown words are an error."""
    words = _split(prompt, known)
    if not words:
        raise PromptError("The prompt is empty.", advice="Name an object, for example: a tall vase.")
    reading = _Reading(known, words, nouns=[], whole=[], parts=[], unknown=[])
    pending: list[str] = []
    for word in words:
        if word in FILLERS:
            continue
        part, noun = part_of(word), noun_of(word, known)
        if part is not None and (reading.nouns or noun is None):
            reading.parts.append((part, pending))
            pending = []
        elif noun is not None:
            reading.nouns.append(noun)
            reading.whole.extend(pending)
            pending = []
        elif is_adjective(word):
            pending.append(word)
        else:
            reading.unknown.append(word)
    reading.whole.extend(pending)  # "a vase, tall and thin"
    if reading.unknown:
        words = reading.unknown
        raise reading.refusal(f"The built-in model does not understand {_listed(words, 'and')}.", words)
    return reading


def _split(prompt: str, known: Words) -> list[str]:
    """Return the words in lower case; a compound with an unknown word stays one: "low-poly" says nothing of height."""
    text = prompt.lower().replace("low poly", "low-poly")
    for compound in (name for name in (*known.nouns, *known.synonyms) if "-" in name):
        text = re.sub(rf"\b{re.escape(compound).replace('-', '[ -]+')}(?=s?\b)", compound, text)
    found: list[str] = []
    for word in re.findall(r"[^\W_]+(?:['-][^\W_]+)*", text):
        pieces = [word] if noun_of(word, known) else word.split("-")
        found += pieces if all(is_known(piece, known) for piece in pieces) else [word]
    return found


def _assemble(reading: _Reading) -> ParsedPrompt:
    """Check that known words fit together, and put them in canonical order."""
    if len(set(reading.nouns)) != 1:
        found = f"{_listed(dict.fromkeys(reading.nouns), 'and')} were found" if reading.nouns else "None was found"
        raise reading.refusal(
            f"The built-in model needs exactly one object in the prompt, such as 'a mushroom'. {found}.", []
        )
    noun = reading.nouns[0]
    parts_of_noun = reading.known.nouns[noun]
    found_attributes: list[Attribute] = []
    for word in reading.whole:
        degree = word if word in ADJECTIVES else ADJECTIVE_SYNONYMS.get(word)
        if degree is None:
            raise reading.refusal(f"{word!r} has no effect: the asset is scaled to fit its frame.", [word])
        found_attributes.append(Attribute("whole", degree))
    for part, words in reading.parts:
        if part not in parts_of_noun:
            own = ", ".join(parts_of_noun) or "none"
            raise reading.refusal(f"The {noun} of the built-in model has no {part} (its parts: {own}).", [part])
        degrees = {degree_of(word, part) for word in words}
        if len(degrees) != 1 or None in degrees:
            low, high = PARTS[part]
            raise reading.refusal(f"Use either {low!r} or {high!r} with the {part}.", [*words, part])
        found_attributes += [Attribute(part, degree) for degree in degrees if degree is not None]
    unique = _ordered(found_attributes)
    per_part = [attribute.part for attribute in unique if attribute.part != "whole"]
    if len(per_part) != len(set(per_part)):
        raise reading.refusal("The prompt gives opposite sizes for one part.", [])
    of_whole = {attribute.degree for attribute in unique if attribute.part == "whole"}
    clash = next((pair for pair in OPPOSITES if pair <= of_whole), None)
    if clash:
        raise reading.refusal(f"Nothing can be {' and '.join(sorted(clash))} at once.", [])
    if len(unique) > MAX_ATTRIBUTES:
        raise PromptError(
            f"The built-in model takes at most {MAX_ATTRIBUTES} attributes, and the prompt has {len(unique)}.",
            advice="Remove some of them.",
        )
    return ParsedPrompt(noun, unique)


def tokenise(parsed: ParsedPrompt, known: Words = BUILTIN_WORDS) -> list[int]:
    """Return the `SEQUENCE_LENGTH` token numbers of a parsed prompt, padded with 0."""
    numbers = [known.tokens.index(word) for word in parsed.tokens]
    return numbers + [0] * (SEQUENCE_LENGTH - len(numbers))
