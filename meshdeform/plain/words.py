"""Read changes in plain words: an operation, a part, its side and an amount each. Pure Python.

::

    sentence = clause {("and" | "," | "but" | "with" | "then") clause}
    clause   = [verb] [article] {amount | adjective | side | part | noun | "too"} | "not" {adjective | part}

"tall and thin", "longer legs and a bigger head", "make the neck twice as long", "legs longer by a third", "slightly
wider", "20 % taller", "30 cm wider", "half the height", "the legs are too short", "longer legs but not the arms". An
adjective without a part is about the whole; "longer and thicker legs" share their part, "longer legs and arms" their
adjective. Whatever is not understood makes the whole sentence none.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from meshdeform.errors import PromptError
from meshdeform.plain import table
from meshdeform.plain.table import SHAPES, WHOLE
from meshdeform.plain.vocabulary import (
    AMOUNTS,
    COUNT,
    DETERMINERS,
    FILLERS,
    FRACTION,
    LESS,
    MEASURES,
    MORE,
    PART_NAMES,
    PART_OF,
    SIDES,
    SLIGHT,
    STRONG,
    TIMES,
    UNITS,
    adjective,
    number,
    singular,
)
from meshdeform.plain.wording import in_known_words

_USUAL = {"tall": 1.4, "long": 1.4, "deep": 1.4, "wide": 1.35, "fat": 1.5, "big": 1.45, "high": 1.4}
_FATTER = 1.6
"""The same of a fat whole: less is hardly seen."""
_SLIGHTLY, _MUCH = 0.4, 1.8
MOST = 5.0
"""Greatest factor; its inverse is the least."""
_LIMBS = frozenset({"leg", "arm", "jaw", "body", "back"})
"""What "upper" and "lower" may stand before as a part of its name."""


@dataclass(frozen=True)
class Change:
    """One change that a sentence asks for."""

    operation: str  # a column of `table.TABLE`
    part: str  # a part in the singular, or `WHOLE`
    factor: float
    """How many times as tall, long, ... it is to be; of `SHAPES` the strength."""
    sides: tuple[str, ...] = ()
    """Of `left`, `right`, `front`, `rear`, `upper`, `lower`, `middle`: only the pieces there."""
    metres: float | None = None
    """In place of the factor: the length that it is to have, or, if `added`, to gain or to lose."""
    added: bool = False

    @property
    def name(self) -> str:
        """The part with its sides, as in a sentence."""
        return " ".join([*self.sides, self.part])


@dataclass(frozen=True)
class Sentence:
    """The meaning of a sentence."""

    changes: tuple[Change, ...]  # at least one
    noun: str | None  # what the sentence says the asset is
    compared: bool
    """Whether it compares, counts or commands ("longer", "twice as", "widen"), as no description of a thing does."""
    notes: tuple[str, ...] = ()  # how words were read that are misspelt, or mean the noun

    @property
    def names_known_parts(self) -> bool:
        """Whether all its parts are words for parts, and none a name that only the file can know."""
        return all(change.part in (WHOLE, *PART_NAMES) for change in self.changes)


@dataclass(frozen=True)
class _Asked:
    """An adjective or a verb; without an operation, an amount alone."""

    operation: str
    less: bool = False
    compares: bool = False


@dataclass
class _Clause:
    """The words of one clause by their role, in order."""

    asked: list[_Asked] = field(default_factory=list)
    part: str | None = None
    sides: tuple[str, ...] = ()
    part_first: bool = False
    determined: bool = False
    negated: bool = False
    after: str = ""
    times: tuple[str, float] | None = None
    strength: float = 1.0
    noun: str | None = None
    compared: bool = False

    def change(self, asked: _Asked, sentence: str) -> Change:
        """Return the change that one of its adjectives asks for."""
        part = self.part or WHOLE
        operation = table.meaning(asked.operation, part)
        if operation == "raise":
            if part == WHOLE:
                raise PromptError(
                    f"{sentence!r} moves the whole, which stays where it stands.",
                    advice="Name a part, such as the seat, or say 'taller'.",
                )
            operation = table.meaning("high", part)
        if self.times is not None and self.times[0] in ("length", "length_to"):
            added = self.times[0] == "length" and asked.compares
            return Change(
                operation, part, 1.0, self.sides, -self.times[1] if asked.less and added else self.times[1], added
            )
        usual = _USUAL.get(asked.operation, _USUAL.get(operation, 1.0))
        if operation == "fat" and not asked.less and part == WHOLE:
            usual = _FATTER
        return Change(operation, part, self._factor(operation, usual, asked.less, sentence), self.sides)

    def _factor(self, operation: str, usual: float, less: bool, sentence: str) -> float:
        """Return the factor of one of its operations, which has a usual one."""
        if operation in SHAPES:
            return self.strength if self.times is None else self.times[1]
        base = 1 + self.strength * (usual - 1)
        if self.times is not None:
            how, amount = self.times
            base = amount if how == "to" else 1 + amount if how == "by" else amount
            if how == "by" and less:
                base = 1 / (1 - amount) if amount < 1 else 0.0
            if how in ("to", "as") and less and amount < 1:  # "half as short" is taken for half
                base = 1 / amount if amount else 0.0
        factor = 1 / base if less and base else base
        check_factor(factor, sentence)
        return factor


def check_factor(factor: float, sentence: str) -> None:
    """Raise PromptError: a change is too large or too small."""
    if not 1 / MOST <= factor <= MOST:
        raise PromptError(
            f"{sentence!r} asks for {factor:.3g} times of something.",
            advice=f"A change is between a fifth and {MOST:g} times.",
        )


def read_changes(text: str, noun_of: Callable[[str], str | None] = lambda _: None) -> Sentence | None:
    """Read the changes that a sentence asks for.

    `text`: for example "longer legs and a bigger head", in English, German or Spanish; `noun_of`: returns the canonical
    noun of a word that names a thing, or None. Returns none if a word is not understood, or no change is asked for.
    Words that are no part anybody knows count as the name of one only beside a comparative, an amount or a verb. Raises
    PromptError: it asks for opposite changes of one part, for more than a fifth to five times, or for what is not to
    change in a way that cannot be kept.
    """
    known, notes = in_known_words(text.lower().replace("-", " "), noun_of)
    amounts: list[tuple[str, float]] = []

    def marked(match: re.Match[str]) -> str:
        amounts.append(_amount(match, known[match.end() :]))
        return f" §{len(amounts) - 1} "

    clauses: list[_Clause] = []
    for after, words in _split(AMOUNTS.sub(marked, known)):
        clause = _read_clause(words, after, amounts, noun_of)
        if clause is None:
            return None
        if clause.asked or clause.part or clause.noun or clause.times:
            clauses.append(clause)
    kept, clauses = [each for each in clauses if each.negated], [each for each in clauses if not each.negated]
    nouns = dict.fromkeys(clause.noun for clause in clauses if clause.noun)
    compared = any(clause.compared or clause.times for clause in clauses)
    if len(nouns) > 1 or not any(clause.asked for clause in clauses):
        return None
    unknown = any(clause.part and clause.part not in PART_NAMES for clause in clauses)
    if unknown and not compared:
        return None
    changes = _joined(clauses, text)
    if changes is None:
        return None
    impossible = next((each for each in changes if table.direction(each.operation, each.part) is None), None)
    if impossible is not None:
        if not compared:
            return None
        raise _not_in_table(impossible)
    for clause in kept:
        _check_kept(clause, changes, text)
    return Sentence(_without_opposites(changes, text), next(iter(nouns), None), compared, notes)


def _not_in_table(change: Change) -> PromptError:
    words = table.OF_PARTS.get(change.operation)
    asked = change.operation if words is None else f"{words[0]} or {words[1]}"
    can = table.possible(change.part)
    return PromptError(
        f"A part such as the {change.part} cannot be {asked}.",
        advice=f"It can be {', '.join(can[:-1])} or {can[-1]}." if len(can) > 1 else f"It can be {can[0]}.",
    )


def described(noun: str, attributes: Iterable[tuple[str, str]]) -> Sentence:
    """Return the changes that give a thing its attributes, each a part or `WHOLE`, and an adjective."""
    changes = []
    for named, degree in attributes:
        meaning = adjective(degree)
        part = None if named == WHOLE else PART_OF.get(singular(named), singular(named))
        if meaning is not None:
            changes.append(_Clause(part=part).change(_Asked(*meaning), f"{degree} {named}"))
    return Sentence(tuple(dict.fromkeys(changes)), noun, compared=False)


def _amount(match: re.Match[str], rest: str) -> tuple[str, float]:
    """Return how an amount counts, `by` (added), `as` (times), `to` or `length`, and what it is."""
    groups: Mapping[str, str | None] = match.groupdict()
    if groups["percent"]:
        share = number(groups["percent"]) / 100
        return ("to", share) if groups["to"] or _as_follows(rest) else ("by", share)
    if groups["length"]:
        return "length_to" if groups["length_to"] else "length", number(groups["length"]) * UNITS[groups["unit"] or "m"]
    if groups["count"]:
        return "as", number(groups["count"]) + (0.5 if groups["half"] else 0.0)
    if groups["factor"]:
        return "as", number(groups["factor"])
    if groups["part"]:
        share = COUNT[groups["many"] or "a"] * FRACTION[groups["part"]]
        return ("as", share) if not groups["by"] and _as_follows(rest) else ("by", share)
    if groups["by_half"]:
        return "by", 0.5
    return "as", TIMES[groups["word"] or ""]


def _as_follows(rest: str) -> bool:
    return re.match(r"\s*(?:as|of|the)\b", rest) is not None


def _split(text: str) -> list[tuple[str, list[str]]]:
    """Return the words of each clause, with what stands before it."""
    clauses: list[tuple[str, list[str]]] = []
    after, words = "", list[str]()
    for word in re.findall(r"§\d+|[^\W_]+(?:'[^\W_]+)?|[,;.]", text):
        if word in ("and", "but", "with", "then", ",", ";", "."):
            if words:
                clauses.append((after, words))
                after, words = word, []
            elif word == "with":
                after = word
            continue
        words.append(word)
    return [*clauses, (after, words)]


def _read_clause(
    words: list[str], after: str, amounts: list[tuple[str, float]], noun_of: Callable[[str], str | None]
) -> _Clause | None:
    """Read one clause; None if it is not understood."""
    clause = _Clause(after=after, determined=bool(words) and words[0] in DETERMINERS)
    named: list[str] = []
    less = flipped = False
    for index, written in enumerate(words):
        word = written if written in FILLERS else written.removesuffix("'s")  # the horse's legs
        found = adjective(word)
        if word.startswith("§"):
            clause.times = amounts[int(word[1:])]
        elif word in SLIGHT or (
            word == "little" and index and words[index - 1] == "a" and _compares(words[index + 1 :])
        ):
            clause.strength = _SLIGHTLY
        elif word in STRONG:
            clause.strength = _MUCH
        elif word in ("less", *LESS):
            less, clause.compared = True, True
        elif word == "too":
            flipped = clause.compared = True
        elif word == "not":
            clause.negated = True
        elif word in FILLERS or word in MORE:
            clause.compared |= word == "more" or word in MORE
        elif word in MEASURES and (clause.times or clause.compared):
            clause.asked.append(_Asked(MEASURES[word], less, clause.compared))
            less = False
        elif _is_of_name(words, index):
            named.append(word if singular(words[index + 1]) in _LIMBS else f"§{word}")
        elif found is not None:
            operation, negative, compares = found
            clause.asked.append(_Asked(operation, negative != (less != flipped), compares or less))
            clause.compared |= compares
            less = flipped = False
        elif (noun := noun_of(word)) is not None and clause.noun is None and singular(word) not in PART_OF:
            clause.noun = noun
        else:
            named.append(PART_OF.get(singular(word), singular(word)) if word not in SIDES else word)
            clause.part_first = not clause.asked
    clause.sides, clause.part = part_and_sides(named)
    if clause.part and clause.times and not clause.asked and not clause.negated and clause.times[0] == "as":
        clause.asked.append(_Asked(""))  # "legs 1.2x"
    return clause


def _is_of_name(words: list[str], index: int) -> bool:
    """Return whether "upper" or "lower" belongs to the name of a part: in "thicker lower legs", not in "lower legs"."""
    following = singular(words[index + 1]) if index + 1 < len(words) else ""
    if words[index] not in ("upper", "lower") or (following not in _LIMBS and following not in PART_OF):
        return False
    others = (word for number, word in enumerate(words) if number != index)
    return words[index] == "upper" or any(adjective(word) is not None for word in others)


def part_and_sides(named: list[str]) -> tuple[tuple[str, ...], str | None]:
    """Return the sides and the part that words name: "back" is a side before a leg, and a part alone."""
    nouns = [word for word in named if word not in SIDES]
    if not nouns:
        return (), " ".join(named) or None
    return tuple(dict.fromkeys(SIDES[word] for word in named if word in SIDES)), " ".join(nouns)


def _compares(words: list[str]) -> bool:
    found = adjective(words[0]) if words else None
    return found is not None and found[2]


def _joined(clauses: list[_Clause], text: str) -> list[Change] | None:
    """Give clauses what they share with those beside them, and return all changes; None if one lacks its half."""
    for here, following in itertools.pairwise(clauses):
        lists = following.after in ("and", ",", "then")
        if not following.asked and following.part and here.asked and here.part and lists:  # legs and arms
            following.asked, following.times, following.strength = here.asked, here.times, here.strength
        elif not following.part and here.part and here.part_first and lists and not following.noun:  # ... and thicker
            following.part, following.sides, following.part_first = here.part, here.sides, True
    for here, following in zip(clauses[-2::-1], clauses[:0:-1], strict=False):
        lists = following.after in ("and", ",")
        if not here.asked and here.part and following.asked and following.part and lists:
            here.asked, here.times, here.strength = following.asked, following.times, following.strength
        elif here.asked and not here.part and not here.noun and following.part and not following.determined:
            same = {table.meaning(each.operation, following.part) for each in following.asked}
            apart = not any(table.meaning(each.operation, following.part) in same for each in here.asked)
            if lists and not following.part_first and apart:
                here.part, here.sides = following.part, following.sides
    if any(clause.part and not clause.asked for clause in clauses):
        return None
    if any(clause.times and not clause.asked for clause in clauses):
        return None
    return [clause.change(asked, text) for clause in clauses for asked in clause.asked]


def _check_kept(clause: _Clause, changes: list[Change], text: str) -> None:
    """Refuse what is not to change, where the changes that are asked for would change it."""
    if clause.part is not None:
        touching = [each for each in changes if each.part in (WHOLE, clause.part)]
        if touching:
            raise PromptError(
                f"{text!r} leaves out the {clause.part}, and a change of the {touching[0].part} changes it as well.",
                advice="Name the parts that are to change: longer legs and arms.",
            )
        return
    kept = {table.meaning(asked.operation, each.part) for asked in clause.asked for each in changes}
    touching = [each for each in changes if each.operation in kept or each.operation == "big"]
    if touching or not clause.asked:
        raise PromptError(
            f"{text!r} says what is not to change, and what it asks for changes that as well.",
            advice="Say only what is to change: wider and longer.",
        )


def _without_opposites(changes: list[Change], text: str) -> tuple[Change, ...]:
    """Return the changes once each; refuse those that undo each other."""
    distinct = list(dict.fromkeys(changes))
    for index, change in enumerate(distinct):
        for other in distinct[:index]:
            same = (change.operation, change.name) == (other.operation, other.name)
            if same and (change.factor - 1) * (other.factor - 1) < 0 and change.operation not in SHAPES:
                raise PromptError(
                    f"{text!r} asks for more and for less of the {change.name} at once.",
                    advice="Leave one of them out.",
                )
    return tuple(distinct)
