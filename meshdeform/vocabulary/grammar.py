"""Parse prompts.

::

    prompt     = [article] {adjective} noun {("with" | "and" | ",") [article] (degree part | borrowed)}
    borrowed   = noun"'s" [degree] part | noun part | part "of" noun          for shapes alone
    adjective  = tall | short | thin | fat | wide | long | flat | twisted | leaning | bent | tapered |
                 pinched | boxy | rounded | a look (`looks`)
    degree     = long | short | big | small          part = neck | legs | head | ...

Every noun takes every adjective; `Words` lists the parts of each noun. Synonyms, plurals, capitals and articles are
accepted. Anything else is an error that suggests prompts: ignoring half of a prompt silently would be worse.

It needs neither torch nor numpy: the service checks a prompt before it accepts the job.

German and Spanish prompts are translated word by word (`translation`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import NamedTuple

from meshdeform.errors import PromptError, VocabularyError
from meshdeform.vocabulary.looks import LOOKS
from meshdeform.vocabulary.lookup import (
    ATTRIBUTES,
    WORDS,
    Attribute,
    Words,
    current_words,
    degree_of,
    is_adjective,
    is_known,
    noun_of,
    part_of,
    singular_forms,
)
from meshdeform.vocabulary.near_words import MAX_SUGGESTIONS, correct, is_english_noun, nearest_nouns
from meshdeform.vocabulary.nouns import PARTS
from meshdeform.vocabulary.solids import part_label, parts_of
from meshdeform.vocabulary.translation import translated
from meshdeform.vocabulary.words import (
    ADJECTIVE_SYNONYMS,
    ADJECTIVES,
    FILLERS,
    INTENSIFIERS,
    JOINING,
    NUMBERS,
    OPPOSITES,
    PAIRS,
    SURFACES,
)

_POPULAR = ("mushroom", "vase", "rabbit")

_OWN_WORDS = "All words: meshdeform models shapes, or GET /v1/models. Add yours: meshdeform words add FILE --noun NOUN."
_FREE_TEXT = "Free text needs a Stable Diffusion model (params.guidance.model)."
_ADVICE = f"All words: meshdeform models builtin, or GET /v1/models. {_FREE_TEXT}"
_NOT_LENT = ("neck", "stem", "trunk", "tower")
"""Parts that others stand on."""
MAX_ATTRIBUTES = 3
_Parts = list[tuple[str, list[str]]]
_BORROWED = ("part noun", "noun part", "degree part noun", "noun degree part", "degree noun part")
"""Orders of words that tell a part of another noun."""


class Borrowed(NamedTuple):
    """A part that a noun has of another: `Borrowed("ears", "rabbit", "long")` are a rabbit's long ears."""

    part: str
    noun: str
    degree: str | None = None

    @property
    def attributes(self) -> tuple[Attribute, ...]:
        """What the other noun is to have."""
        return () if self.degree is None else (Attribute(self.part, self.degree),)

    def __str__(self) -> str:
        """Return it as written in a prompt."""
        return f"{_articled(self.noun)}'s {self.degree or ''} {self.part}".replace("  ", " ")


@dataclass(frozen=True)
class ParsedPrompt:
    """Noun and attributes of a prompt, and the parts that it has of other nouns.

    `notes`: sentences on words that mean the noun and are not its name, such as `hound`, or that change nothing.
    """

    noun: str
    attributes: tuple[Attribute, ...] = ()
    borrowed: tuple[Borrowed, ...] = ()
    notes: tuple[str, ...] = field(default=(), compare=False)

    @property
    def tokens(self) -> tuple[str, ...]:
        """Canonical words: the noun, then (degree, part) of each attribute."""
        return (self.noun, *(word for attribute in self.attributes for word in (attribute.degree, attribute.part)))

    def __str__(self) -> str:
        """Return an English prompt with this meaning."""
        whole = [attribute.degree for attribute in self.attributes if attribute.part == "whole"]
        parts = [attribute for attribute in self.attributes if attribute.part != "whole"]
        front = _articled(" ".join([*whole, self.noun]))
        clauses = [f"{a.degree} {a.part}" if a.part.endswith("s") else f"a {a.degree} {a.part}" for a in parts]
        clauses += map(str, self.borrowed)
        return front + (f" with {' and '.join(clauses)}" if clauses else "")


def _articled(words: str) -> str:
    """Return words with an article, if they take one; a noun of several words is written without hyphens."""
    article = "" if words.rpartition(" ")[2] in PAIRS else "an " if words[0] in "aeiou" else "a "
    return article + words.replace("-", " ")


@dataclass(frozen=True)
class Suggestions:
    """Prompts to use in place of a refused one."""

    prompts: list[str]  # one to three prompts that are accepted and keep what was understood
    corrections: dict[str, str]  # the known word in place of each misspelt one
    nearest: dict[str, list[str]]
    """By unknown word, known nouns that look like it or mean something similar; nearest first."""
    near: bool  # whether the prompts come from the refused one, and are not merely examples


@dataclass(frozen=True)
class _Reading:
    """The words of a prompt by their role, in order, and the words that the model knows."""

    vocabulary: Words
    words: list[str]
    nouns: list[str]
    whole: list[str]
    parts: _Parts
    borrowed: list[Borrowed]
    unknown: list[str]

    def refusal(self, detail: str, unknown: list[str]) -> VocabularyError:
        """Return an error with whole prompts that work instead, and with the vocabulary as data."""
        suggestion = _suggest(self)
        offer = (
            f"Did you mean {_listed(suggestion.prompts, 'or')}?"
            if suggestion.near
            else f"Try {_listed(suggestion.prompts, 'or')}."
        )
        return VocabularyError(
            detail,
            advice=f"{offer} {_ADVICE if self.vocabulary.tokens else f'{_OWN_WORDS} {_FREE_TEXT}'}",
            unknown=unknown,
            suggestions=suggestion.prompts,
            corrections=suggestion.corrections,
            nearest=suggestion.nearest,
            nouns=sorted(self.vocabulary.nouns),
            attributes=[*ADJECTIVES, *(f"{low}/{high} {part}" for part, (low, high) in PARTS.items())],
        )


def _suggest(reading: _Reading) -> Suggestions:
    """Return prompts in place of a refused one, with what was understood of it and its misspelt words corrected."""
    vocabulary = reading.vocabulary
    corrections = correct(reading.unknown, with_nouns=not reading.nouns, words=vocabulary)
    if corrections:
        words = [corrections.get(word, word) for word in reading.words]
        reading = _by_role(words, reading.borrowed, vocabulary)
    chosen, near = reading.nouns, dict[str, list[str]]()
    if not chosen:
        looks = [word for word in reading.whole if word in LOOKS]
        told = [*reading.unknown, *(part for part, _ in reading.parts), *looks]
        near = {word: nouns for word in told if (nouns := nearest_nouns(word, vocabulary))}
        chosen = [noun for nouns in near.values() for noun in nouns]
    prompts: list[str] = []
    for noun in dict.fromkeys(chosen or [noun for noun in _POPULAR if noun in vocabulary.nouns] or vocabulary.nouns):
        candidates = [*_of_whole(noun, reading), *_of_parts(noun, reading)]
        borrowed = tuple(each for each in reading.borrowed if _refused(each, noun, vocabulary) is None)
        # The first of two attributes that contradict each other, or the last.
        prompts += [str(_fitted(noun, order, borrowed)) for order in (candidates, candidates[::-1])]
    meant = bool((near or corrections or reading.unknown) and chosen)
    return Suggestions(list(dict.fromkeys(prompts))[:MAX_SUGGESTIONS], corrections, near, meant)


def _of_whole(noun: str, reading: _Reading) -> list[Attribute]:
    attributes: list[Attribute] = []
    for word in reading.whole:
        degree = word if word in ADJECTIVES else ADJECTIVE_SYNONYMS.get(word)
        if degree is not None:
            attributes.append(Attribute("whole", degree))
        elif word in LOOKS and not reading.vocabulary.tokens:
            attributes += _of_look(word, noun, attributes, reading.vocabulary)
    return attributes


def _of_parts(noun: str, reading: _Reading) -> list[Attribute]:
    attributes = []
    for part, sizes in reading.parts:
        if part in reading.vocabulary.nouns[noun]:
            degrees = [degree for size in sizes if (degree := degree_of(size, part))]
            attributes += [Attribute(part, degree) for degree in degrees or PARTS[part]]
    return attributes


def _fitted(noun: str, candidates: Iterable[Attribute], borrowed: tuple[Borrowed, ...]) -> ParsedPrompt:
    """Return a prompt with each attribute that does not contradict those before it."""
    fitted: list[Attribute] = []
    for attribute in candidates:
        of_whole = {other.degree for other in [*fitted, attribute] if other.part == "whole"}
        clash = any(pair <= of_whole for pair in OPPOSITES)
        sized = attribute.part != "whole" and any(other.part == attribute.part for other in fitted)
        if attribute not in fitted and not clash and not sized and len(fitted) < MAX_ATTRIBUTES:
            fitted.append(attribute)
    return ParsedPrompt(noun, tuple(sorted(fitted, key=ATTRIBUTES.index)), borrowed)


def _listed(items: Iterable[str], conjunction: str) -> str:
    quoted = [repr(item) for item in items]
    return f" {conjunction} ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))


def parse(prompt: str, vocabulary: Words | None = None) -> ParsedPrompt:
    """Parse a prompt of the builtin prior.

    `prompt`: for example "a tall, thin vase" or "a Giraffe with a long neck and short legs". `vocabulary`: the words
    that it may have; by default those that are known here. Returns ParsedPrompt: canonical noun and attributes, equal
    for prompts with the same meaning. Raises PromptError: the prompt is empty or has more than three attributes. Raises
    VocabularyError: a word, a part or a combination is not supported. Its extras: `unknown` (words), `suggestions` (up
    to three prompts that are accepted), `corrections` (of misspelt words), `nearest` (known nouns of similar meaning,
    by unknown word), `nouns` and `attributes`.
    """
    return _assemble(_read(prompt, vocabulary or current_words()))


def parse_negative(negative: str, prompt: str, vocabulary: Words | None = None) -> ParsedPrompt:
    """Parse a negative prompt of the builtin prior.

    `negative`: a prompt ("a chair"), or only attributes ("fat", "a long neck"), which apply to the prompt's noun;
    `prompt`: the prompt that it accompanies; `vocabulary`: as in `parse`. Raises PromptError: as `parse`; or the
    negative prompt means the same as the prompt. Raises VocabularyError: as `parse`, but without suggestions, which are
    for prompts.
    """
    vocabulary = vocabulary or current_words()
    wanted = parse(prompt, vocabulary)
    try:
        reading = _read(negative, vocabulary)
        unwanted = _assemble(replace(reading, nouns=reading.nouns or [wanted.noun]))
    except VocabularyError as error:
        extra = {**error.extra, "suggestions": [], "nearest": {}}
        raise VocabularyError(f"In the negative prompt: {error.detail}", advice=_ADVICE, **extra) from error
    if unwanted == wanted:
        raise PromptError(
            f"The negative prompt {negative!r} means the same as the prompt {prompt!r}.",
            advice="Remove from one what is in the other.",
        )
    return unwanted


def named_nouns(text: str) -> set[str]:
    """Return the nouns that are known here and that a text names, also one that is no prompt."""
    return {noun for word in _split(text, current_words()) if (noun := noun_of(word)) is not None}


def _read(prompt: str, vocabulary: Words) -> _Reading:
    """Return the words of a prompt by their role; unknown words are an error."""
    words = _split(prompt, vocabulary)
    if not words:
        raise PromptError("The prompt is empty.", advice="Name an object, for example: a tall vase.")
    reading = _by_role(*_without_borrowed(words, vocabulary), vocabulary)
    if reading.unknown:
        raise reading.refusal(" ".join(_reasons(reading)), reading.unknown)
    return reading


def _by_role(words: list[str], borrowed: list[Borrowed], vocabulary: Words) -> _Reading:
    """Return words by their role."""
    reading = _Reading(vocabulary, words, nouns=[], whole=[], parts=[], borrowed=borrowed, unknown=[])
    pending: list[str] = []
    of_parts = False
    for word in words:
        of_parts |= word in ("with", "has", "having")
        if word in FILLERS or word in INTENSIFIERS:
            continue
        part, noun = part_of(word), noun_of(word, vocabulary)
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
            pending = [] if of_parts else pending  # of a part that is not known
    reading.whole.extend(pending)  # "a vase, tall and thin"
    if "pair" in reading.unknown and PAIRS.intersection(reading.nouns):
        reading.unknown.remove("pair")
    return reading


def _reasons(reading: _Reading) -> Iterator[str]:
    """Yield a sentence for each kind of words that were not understood."""
    numbers = [word for word in reading.unknown if word in NUMBERS or word.isdigit()]
    surfaces = [word for word in reading.unknown if reading.nouns and word in SURFACES]
    rest = dict.fromkeys(word for word in reading.unknown if word not in (*numbers, *surfaces))
    if numbers:
        yield f"One asset becomes one thing, with the parts it has: leave {_listed(numbers, 'and')} out."
    if surfaces:
        yield f"Colours and materials stay as they are in the asset: leave {_listed(surfaces, 'and')} out."
    if not rest:
        return
    if reading.vocabulary.tokens:
        yield from _unknown_to_the_prior(list(rest))
    elif reading.nouns:
        does = "does" if len(rest) == 1 else "do"
        yield f"A prompt says what a thing is and how it is shaped, which {_listed(rest, 'and')} {does} not."
    else:
        count = len(reading.vocabulary.nouns)
        yield f"There is no shape for {_listed(rest, 'and')}: {count} nouns are known, with some attributes."


def _unknown_to_the_prior(words: Sequence[str]) -> Iterator[str]:
    """Yield a sentence on words that shapes have and the built-in model lacks, and one on those that nothing has."""
    shapes = [word for word in words if is_known(word, WORDS)]
    if shapes:
        yield f"The built-in model does not know {_listed(shapes, 'and')}: guidance `exemplar` does."
    if others := [word for word in words if word not in shapes]:
        yield f"The built-in model does not understand {_listed(others, 'and')}."


def _without_borrowed(words: list[str], vocabulary: Words) -> tuple[list[str], list[Borrowed]]:
    """Return words without parts of other nouns, and these: "a rabbit's ears", "rabbit ears", "ears of a rabbit"."""
    kept: list[str] = []
    borrowed: list[Borrowed] = []
    rest = list(words)
    while rest:
        phrase = _borrowed_first(rest, vocabulary) if any(noun_of(word, vocabulary) for word in kept) else None
        if phrase is None:
            kept.append(rest.pop(0))
        else:
            borrowed.append(phrase[0])
            del rest[: phrase[1]]
    return kept, borrowed


def _borrowed_first(words: Sequence[str], vocabulary: Words) -> tuple[Borrowed, int] | None:
    """Return the part of another noun with which words begin, and how many of them say so."""
    phrase = list(takewhile(lambda word: word not in JOINING, words))
    indices = [index for index, word in enumerate(phrase) if word not in FILLERS]
    for order in _BORROWED:
        roles = order.split()
        if len(indices) < len(roles):
            continue
        at = dict(zip(roles, indices, strict=False))
        owner, part = phrase[at["noun"]], part_of(phrase[at["part"]])
        noun = noun_of(owner.removesuffix("'s").removesuffix("'"), vocabulary)
        if noun is None or part is None:
            continue
        degree = degree_of(phrase[at["degree"]], part) if "degree" in at else None
        belongs = (
            at["noun"] > at["part"] + 1 if at["noun"] > at["part"] else "'" in owner or order != "noun degree part"
        )
        if belongs and ("degree" not in at or degree is not None):
            return Borrowed(part, noun, degree), max(at.values()) + 1
    return None


def _split(prompt: str, vocabulary: Words) -> list[str]:
    """Return the words in lower case; a compound with an unknown word stays one: "low-poly" says nothing of height."""
    text = prompt.lower().replace("low poly", "low-poly").replace("\u2019", "'")
    for compound in sorted(
        (name for name in (*vocabulary.nouns, *vocabulary.synonyms) if "-" in name), key=len, reverse=True
    ):
        text = re.sub(rf"\b{compound.replace('-', '[ -]+')}(?=s?\b)", compound, text)
    words: list[str] = []
    for word in re.findall(r"[^\W_]+(?:['-][^\W_]+)*", text):
        pieces = [word] if noun_of(word, vocabulary) else _pieces(word)
        words += pieces if all(is_known(piece, vocabulary) for piece in pieces) else [word]
    return _in_english(words, vocabulary)


def _pieces(word: str) -> list[str]:
    """Return the words that hyphens join, with the part of one such as "long-necked" at the end."""
    *others, last = word.split("-")
    parts = (form for form in (last[:-2], last[:-1], last[:-3]) if last.endswith("ed") and part_of(form))
    return [*others, next(parts, last) if others else last]


def _in_english(words: list[str], vocabulary: Words) -> list[str]:
    """Translate a prompt that has words which are not English: "ein Boot" is a boat, and "a boot" or "bank" are not."""

    def is_english(word: str) -> bool:
        return is_known(word, vocabulary) or is_english_noun(word)

    if all(map(is_english, words)):
        return words
    return translated(
        words,
        is_english,
        lambda word: word not in FILLERS and is_known(word, vocabulary),
        is_adjective,
        lambda word: noun_of(word, vocabulary) is not None,
    )


def _assemble(reading: _Reading) -> ParsedPrompt:
    """Check that known words fit together, and put them in canonical order."""
    if len(set(reading.nouns)) != 1:
        sentence = f"{_listed(dict.fromkeys(reading.nouns), 'and')} were found" if reading.nouns else "None was found"
        raise reading.refusal(f"A prompt needs exactly one object, such as 'a mushroom'. {sentence}.", [])
    noun = reading.nouns[0]
    parts_of_noun = reading.vocabulary.nouns[noun]
    found_attributes: list[Attribute] = []
    looks = [word for word in reading.whole if word in LOOKS and not reading.vocabulary.tokens]
    for word in reading.whole:
        degree = word if word in ADJECTIVES else ADJECTIVE_SYNONYMS.get(word)
        if word in looks:
            continue
        if degree is None and word in LOOKS:
            raise reading.refusal(f"The built-in model does not know {word!r}: guidance `exemplar` does.", [word])
        if degree is None:
            raise reading.refusal(f"{word!r} has no effect: the asset is scaled to fit its frame.", [word])
        found_attributes.append(Attribute("whole", degree))
    for part, words in reading.parts:
        if part not in parts_of_noun:
            own = ", ".join(parts_of_noun) or "none"
            raise reading.refusal(f"The {noun} has no {part} (its parts: {own}).", [part])
        degrees = {degree_of(word, part) for word in words}
        if len(degrees) != 1 or None in degrees:
            low, high = PARTS[part]
            raise reading.refusal(f"Use either {low!r} or {high!r} with the {part}.", [*words, part])
        found_attributes += [Attribute(part, degree) for degree in degrees if degree is not None]
    for look in looks:
        given = _of_look(look, noun, found_attributes, reading.vocabulary)
        if not given:
            raise reading.refusal(f"{look!r} changes nothing of a {noun}.", [look])
        found_attributes += given
    unique = tuple(sorted(set(found_attributes), key=ATTRIBUTES.index))
    per_part = [attribute.part for attribute in unique if attribute.part != "whole"]
    if len(per_part) != len(set(per_part)):
        raise reading.refusal("The prompt gives opposite sizes for one part.", [])
    of_whole = {attribute.degree for attribute in unique if attribute.part == "whole"}
    clash = next((pair for pair in OPPOSITES if pair <= of_whole), None)
    if clash:
        raise reading.refusal(f"Nothing can be {' and '.join(sorted(clash))} at once.", [])
    _check_borrowed(reading)
    if reading.vocabulary.tokens and len(unique) > MAX_ATTRIBUTES:
        raise PromptError(
            f"The built-in model takes at most {MAX_ATTRIBUTES} attributes, and the prompt has {len(unique)}.",
            advice="Remove some of them.",
        )
    return ParsedPrompt(noun, unique, tuple(reading.borrowed), tuple(_notes(noun, reading)))


def _of_look(look: str, noun: str, given: Sequence[Attribute], vocabulary: Words) -> list[Attribute]:
    """Return what a look gives a noun, without what contradicts the attributes that are given."""
    sized = {attribute.part for attribute in given} - {"whole"}
    whole = {attribute.degree for attribute in given if attribute.part == "whole"}
    for alternative in LOOKS[look].split("; "):
        attributes = []
        for text in alternative.split(", "):
            degree, _, part = text.partition(" ")
            if not part and not any({degree, other} in OPPOSITES for other in whole):
                attributes.append(Attribute("whole", degree))
            elif part in vocabulary.nouns[noun] and part not in sized:
                attributes.append(Attribute(part, degree))
        if attributes:
            return attributes
    return []


def _notes(noun: str, reading: _Reading) -> Iterator[str]:
    """Yield a sentence for each word that means the noun and is not its name, or that changes nothing."""
    for word in dict.fromkeys(reading.words):
        if noun_of(word, reading.vocabulary) == noun and noun not in singular_forms(word):
            yield f"{word!r} is read as {noun!r}."
        if word in INTENSIFIERS:
            yield f"{word!r} changes nothing: a prompt cannot say how much."


def _check_borrowed(reading: _Reading) -> None:
    """Refuse parts that another noun, or the own one, does not have."""
    for each in reading.borrowed:
        if reading.vocabulary.tokens:
            raise reading.refusal(f"The built-in model knows no {each.part} of a {each.noun}.", [each.part])
        if (reason := _refused(each, reading.nouns[0], reading.vocabulary)) is not None:
            raise reading.refusal(reason, [each.part])


def _refused(borrowed: Borrowed, noun: str, vocabulary: Words) -> str | None:
    """Return why a noun cannot have a part of another, or None."""
    part, owner, degree = borrowed
    if part in _NOT_LENT:
        return f"A {part} carries more than itself: it cannot be another's."
    for each in (noun, owner):
        if part_label(part) not in parts_of(each) and part not in vocabulary.nouns[each]:
            return f"The {each} has no {part}, which both must have."
    if degree is not None and part not in vocabulary.nouns[owner]:
        return f"The {part} of a {owner} cannot be {degree}."
    return None
