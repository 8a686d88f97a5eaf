"""Read changes in plain words: an operation, a part and an amount each. Pure Python.

::

    sentence = clause {("and" | "," | "but" | "with" | "then") clause}
    clause   = [verb] [article] {amount | adjective | part | noun}

"tall and thin", "longer legs and a bigger head", "make the neck twice as long", "legs longer by a third", "slightly
wider", "20 % taller", "half the height". An adjective without a part is about the whole; "longer and thicker legs"
share their part, "longer legs and arms" their adjective. Whatever is not understood makes the whole sentence none.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from meshdeform.errors import PromptError

WHOLE = "whole"
"""The part of a change of everything."""

SHAPES = frozenset({"tapered", "twisted", "leaning", "bent", "pinched"})
"""Operations whose factor is a strength, 1 as usual, and no ratio of lengths."""

OF_PARTS = {
    "long": ("longer", "shorter"), "big": ("bigger", "smaller"), "tall": ("taller", "shorter"),
    "wide": ("wider", "narrower"), "fat": ("thicker", "thinner"),
}  # fmt: skip
"""The operations on parts, each with the words for more and for less of it."""

_USUAL = {"tall": 1.4, "long": 1.4, "wide": 1.35, "fat": 1.5, "big": 1.45}
_FATTER = 1.6
"""The same of a fat whole: less is hardly seen."""
_SLIGHTLY, _MUCH = 0.4, 1.8
_MOST = 5.0
"""Greatest factor; its inverse is the least."""

_ADJECTIVES = {
    word: (operation.lstrip("-"), operation.startswith("-"))
    for operation, words in {
        "tall": "tall high lofty",
        "-tall": "short low squat stubby flat flattened squashed",
        "long": "long elongated stretched deep",
        "wide": "wide broad",
        "-wide": "narrow",
        "fat": "fat chubby plump obese stout thick round heavy bulky",
        "-fat": "thin slim slender skinny lean slight",
        "big": "big large huge giant great",
        "-big": "small little tiny",
        "tapered": "tapered pointed tapering pointy",
        "twisted": "twisted spiral twisting",
        "leaning": "leaning tilted slanted sloping",
        "bent": "bent curved crooked bowed",
        "pinched": "pinched waisted cinched hourglass",
    }.items()
    for word in words.split()
}
_VERBS = {
    "lengthen": "long", "elongate": "long", "stretch": "long", "shorten": "-tall", "flatten": "-tall",
    "widen": "wide", "broaden": "wide", "fatten": "fat", "thicken": "fat", "slim": "-fat", "enlarge": "big",
    "grow": "big", "enlarged": "big", "shrink": "-big", "twist": "twisted", "bend": "bent", "taper": "tapered",
    "lean": "leaning", "tilt": "leaning", "pinch": "pinched", "heighten": "tall", "deepen": "long",
}  # fmt: skip
_MEASURES = {
    "height": "tall", "width": "wide", "breadth": "wide", "length": "long", "depth": "long", "size": "big",
    "thickness": "fat",
}  # fmt: skip
_IRREGULAR = {"lens": "lens", "feet": "foot", "leaves": "leaf", "teeth": "tooth", "calves": "calf", "hooves": "hoof"}
_PART_OF = {
    word: part
    for part, words in {
        "leg": "leg limb", "arm": "arm tentacle", "head": "head skull", "neck": "neck", "tail": "tail", "ear": "ear",
        "hand": "hand paw fist", "foot": "foot hoof shoe", "wing": "wing flipper", "fin": "fin",
        "horn": "horn antler", "nose": "nose snout beak bill muzzle", "eye": "eye", "hair": "hair mane",
        "trunk": "trunk", "wheel": "wheel tyre tire", "seat": "seat", "top": "top tabletop", "back": "back backrest",
        "roof": "roof", "door": "door", "window": "window", "handle": "handle grip", "stem": "stem stalk",
        "body": "body torso belly trunk chest waist", "base": "base", "lid": "lid", "spout": "spout",
        "crown": "crown foliage canopy", "tower": "tower turret spire", "claw": "claw", "finger": "finger",
        "shell": "shell", "cap": "cap", "hip": "hip", "shoulder": "shoulder", "branch": "branch",
        "chimney": "chimney",
    }.items()
    for word in words.split()
}  # fmt: skip
_PLURALS = {
    "foot": "feet", "branch": "branches", "leg": "legs", "arm": "arms", "hand": "hands", "ear": "ears", "wing": "wings",
    "fin": "fins", "horn": "horns", "eye": "eyes", "wheel": "wheels", "door": "doors", "window": "windows",
    "claw": "claws", "finger": "fingers", "shoulder": "shoulders", "hip": "hips",
}  # fmt: skip
PART_NAMES = {part: _PLURALS.get(part, part) for part in _PART_OF.values()}
"""The parts that words name on any asset, in the singular, each as it is called where an asset has it."""
_FILLERS = frozenset({
    "a", "an", "the", "its", "it", "it's", "is", "be", "this", "that", "make", "made", "let", "give", "please",
    "have", "has", "having", "get", "of", "to", "in", "more", "version", "one", "some", "them", "by", "factor",
    "look", "looks", "looking", "into", "become", "and", "as", "with",
})  # fmt: skip
_LONG = frozenset(["leg", "arm", "neck", "tail", "ear", "horn", "nose", "finger", "wing", "fin", "handle", "stem"])
_DETERMINERS = frozenset({"a", "an", "the", "its"})
_SLIGHT = frozenset({"slightly", "bit", "somewhat"})
_STRONG = frozenset({"much", "very", "way", "far", "lot", "really", "extremely"})
_FRACTION = {"half": 0.5, "third": 1 / 3, "quarter": 0.25, "fourth": 0.25, "fifth": 0.2, "tenth": 0.1}
_COUNT = {"a": 1.0, "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0}
_TIMES = {"twice": 2.0, "double": 2.0, "doubled": 2.0, "thrice": 3.0, "triple": 3.0, "half": 0.5, "halved": 0.5}
_NUMBER = r"(?:\d+(?:\.\d+)?|\b(?:one|two|three|four|five))"
_AMOUNTS = re.compile(
    rf"(?P<to>\bto\s+)?(?P<percent>\d+(?:\.\d+)?)\s*(?:%|per\s?cent\b)"
    rf"|(?P<count>{_NUMBER})(?P<half>\s+and\s+a\s+half)?\s*(?:x\b|times\b)"
    rf"|\bby\s+(?:a\s+factor\s+of\s+)(?P<factor>{_NUMBER})"
    rf"|(?P<by>\bby\s+)?\b(?P<many>a|one|two|three)\s+(?P<part>half|third|quarter|fourth|fifth|tenth)s?\b"
    rf"|(?P<by_half>\bby\s+half\b)"
    rf"|\b(?P<word>twice|doubled?|thrice|triple|half|halved)\b"
)


@dataclass(frozen=True)
class Change:
    """One change that a sentence asks for."""

    operation: str  # `tall`, `long`, `wide`, `fat`, `big`, or one of `SHAPES`
    part: str  # a part in the singular, or `WHOLE`
    factor: float
    """How many times as tall, long, ... it is to be; of `SHAPES` the strength."""


@dataclass(frozen=True)
class Sentence:
    """The meaning of a sentence."""

    changes: tuple[Change, ...]  # at least one
    noun: str | None  # what the sentence says the asset is
    compared: bool
    """Whether it compares, counts or commands ("longer", "twice as", "widen"), as no description of a thing does."""

    @property
    def known(self) -> bool:
        """Whether all its parts are words for parts, and none a name that only the file can know."""
        return all(change.part in (WHOLE, *PART_NAMES) for change in self.changes)


@dataclass
class _Clause:
    """The words of one clause by their role, in order."""

    adjectives: list[tuple[str, bool]] = field(default_factory=list)
    part: str | None = None
    part_first: bool = False
    determined: bool = False
    after: str = ""
    times: tuple[str, float] | None = None
    strength: float = 1.0
    noun: str | None = None
    compared: bool = False

    def factor(self, operation: str, less: bool, sentence: str) -> float:
        """Return the factor of one of its operations."""
        usual = _USUAL.get(operation, 1.0)
        if operation == "fat" and not less and self.part is None:
            usual = _FATTER
        if operation in SHAPES:
            return self.strength if self.times is None else self.times[1]
        base = 1 + self.strength * (usual - 1)
        if self.times is not None:
            how, amount = self.times
            base = amount if how == "to" else 1 + amount if how == "by" else amount
            if how == "by" and less:
                base = 1 / (1 - amount) if amount < 1 else 0.0
            if how == "to" and less:
                base = 1 / amount if amount else 0.0
            if how == "as" and less and amount < 1:  # "half as short" is taken for half
                base = 1 / amount
        factor = 1 / base if less and base else base
        if not 1 / _MOST <= factor <= _MOST:
            raise PromptError(
                f"{sentence!r} asks for {factor:g} times of something.",
                advice=f"A change is between a fifth and {_MOST:g} times.",
            )
        return factor


def singular(word: str) -> str:
    """Return the singular of a noun that may be a plural."""
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    if word.endswith("s") and not word.endswith("ss") and len(word) > 3:
        for stem in (word[:-2] if word.endswith(("ches", "shes", "xes")) else "", word[:-1]):
            if stem:
                return stem
    return word


def read_changes(text: str, noun_of: Callable[[str], str | None] = lambda _: None) -> Sentence | None:
    """Read the changes that a sentence asks for.

    `text`: for example "longer legs and a bigger head"; `noun_of`: returns the canonical noun of a word that names a
    thing, or None. Returns none if a word is not understood, or no change is asked for. Words that are no part anybody
    knows count as the name of one only beside a comparative, an amount or a verb. Raises PromptError: it asks for
    opposite changes of one part, or for more than a fifth to five times.
    """
    lowered = text.lower().replace("-", " ")
    amounts: list[tuple[str, float]] = []

    def marked(match: re.Match[str]) -> str:
        amounts.append(_amount(match, lowered[match.end() :]))
        return f" §{len(amounts) - 1} "

    marks = _AMOUNTS.sub(marked, lowered)
    clauses: list[_Clause] = []
    for after, words in _split(marks):
        clause = _read_clause(words, after, amounts, noun_of)
        if clause is None:
            return None
        if clause.adjectives or clause.part or clause.noun or clause.times:
            clauses.append(clause)
    nouns = dict.fromkeys(clause.noun for clause in clauses if clause.noun)
    compared = any(clause.compared or clause.times for clause in clauses)
    if len(nouns) > 1 or not any(clause.adjectives for clause in clauses):
        return None
    unknown = any(clause.part and clause.part not in PART_NAMES for clause in clauses)
    if unknown and not compared:
        return None
    changes = _joined(clauses, text)
    return None if changes is None else Sentence(_without_opposites(changes, text), next(iter(nouns), None), compared)


def described(noun: str, attributes: Iterable[tuple[str, str]]) -> Sentence:
    """Return the changes that give a thing its attributes, each a part or `WHOLE`, and an adjective."""
    changes = []
    for named, adjective in attributes:
        operation, less = _ADJECTIVES[adjective]
        part = named if named == WHOLE else _PART_OF.get(singular(named), singular(named))
        if adjective == "short" and part != WHOLE:  # the lesser of long
            operation = "long"
        factor = _Clause(part=None if part == WHOLE else part).factor(operation, less, adjective)
        changes.append(Change(_on(operation, part), part, factor))
    return Sentence(tuple(dict.fromkeys(changes)), noun, compared=False)


def _amount(match: re.Match[str], rest: str) -> tuple[str, float]:
    """Return how an amount counts, `by` (added), `as` (times) or `to`, and what it is."""
    groups: Mapping[str, str | None] = match.groupdict()
    if groups["percent"]:
        share = float(groups["percent"]) / 100
        return ("to", share) if groups["to"] or _as_follows(rest) else ("by", share)
    if groups["count"]:
        return "as", _number(groups["count"]) + (0.5 if groups["half"] else 0.0)
    if groups["factor"]:
        return "as", _number(groups["factor"])
    if groups["part"]:
        share = _COUNT[groups["many"] or "a"] * _FRACTION[groups["part"]]
        return ("as", share) if not groups["by"] and _as_follows(rest) else ("by", share)
    if groups["by_half"]:
        return "by", 0.5
    return "as", _TIMES[groups["word"] or ""]


def _number(text: str) -> float:
    return _COUNT[text] if text in _COUNT else float(text)


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
    clause = _Clause(after=after, determined=bool(words) and words[0] in _DETERMINERS)
    named: list[str] = []
    less = False
    for place, written in enumerate(words):
        word = written if written in _FILLERS else written.removesuffix("'s")  # the horse's legs
        if word.startswith("§"):
            clause.times = amounts[int(word[1:])]
            continue
        if word in _SLIGHT or (
            word == "little" and place and words[place - 1] == "a" and _compares(words[place + 1 :])
        ):
            clause.strength = _SLIGHTLY
        elif word in _STRONG:
            clause.strength = _MUCH
        elif word == "less":
            less, clause.compared = True, True
        elif word in _FILLERS:
            clause.compared |= word == "more"
        elif word in _MEASURES and clause.times:
            clause.adjectives.append((_MEASURES[word], False))
        elif (adjective := _adjective(word)) is not None:
            operation, negative, compares = adjective
            clause.adjectives.append((operation, negative != less))
            clause.compared |= compares
            less = False
        elif (part := _PART_OF.get(singular(word))) is not None:
            named.append(part)
            clause.part_first = not clause.adjectives
        elif (noun := noun_of(word)) is not None and clause.noun is None:
            clause.noun = noun
        else:
            named.append(singular(word))
            clause.part_first = not clause.adjectives
    if named:
        clause.part = " ".join(named)
    return clause


def _compares(words: list[str]) -> bool:
    adjective = _adjective(words[0]) if words else None
    return adjective is not None and adjective[2]


def _adjective(word: str) -> tuple[str, bool, bool] | None:
    """Return the operation of an adjective or a verb, whether it is the lesser one, and whether it compares."""
    if word in _ADJECTIVES:
        return (*_ADJECTIVES[word], False)
    if word in _VERBS:
        return _VERBS[word].lstrip("-"), _VERBS[word].startswith("-"), True
    for ending in ("er", "est"):
        if word.endswith(ending):
            base = word.removesuffix(ending)
            stems = [base, base + "e", base[:-1] + "y" if base.endswith("i") else "", base[:-1]]
            for stem in filter(None, stems):
                if stem in _ADJECTIVES and (stem != base[:-1] or base[-1:] == base[-2:-1]):
                    return (*_ADJECTIVES[stem], True)
    return None


def _joined(clauses: list[_Clause], text: str) -> list[Change] | None:
    """Give clauses what they share with those beside them, and return all changes; None if one lacks its half."""
    for here, following in itertools.pairwise(clauses):
        lists = following.after in ("and", ",", "then")
        if not following.adjectives and following.part and here.adjectives and here.part and lists:  # legs and arms
            following.adjectives, following.times, following.strength = here.adjectives, here.times, here.strength
        elif not following.part and here.part and here.part_first and lists and not following.noun:  # ... and thicker
            following.part, following.part_first = here.part, True
    for here, following in zip(clauses[-2::-1], clauses[:0:-1], strict=False):
        lists = following.after in ("and", ",")
        if not here.adjectives and here.part and following.adjectives and following.part and lists:
            here.adjectives, here.times, here.strength = following.adjectives, following.times, following.strength
        elif here.adjectives and not here.part and not here.noun and following.part and not following.determined:
            same = {_on(operation, following.part) for operation, _ in following.adjectives}
            if (
                lists
                and not following.part_first
                and not any(_on(each, following.part) in same for each, _ in here.adjectives)
            ):
                here.part = following.part
    if any(clause.part and not clause.adjectives for clause in clauses):
        return None
    if any(clause.times and not clause.adjectives for clause in clauses):
        return None
    return [
        Change(_on(operation, clause.part or WHOLE), clause.part or WHOLE, clause.factor(operation, less, text))
        for clause in clauses
        for operation, less in clause.adjectives
    ]


def _on(operation: str, part: str) -> str:
    """Return the meaning of an operation on a part: "tall legs" are long ones, and a "wide head" is a big one."""
    if part in _LONG:
        long = ("tall", "long", "big") if part in ("leg", "arm", "neck", "tail") else ("tall", "long")
        return "long" if operation in long else "fat" if operation == "wide" else operation
    if part in ("head", "hand", "foot", "eye", "wheel") and operation not in SHAPES:
        return "big"
    return operation


def _without_opposites(changes: list[Change], text: str) -> tuple[Change, ...]:
    """Return the changes once each; refuse those that undo each other."""
    distinct = list(dict.fromkeys(changes))
    for number, change in enumerate(distinct):
        for other in distinct[:number]:
            same = (change.operation, change.part) == (other.operation, other.part)
            if same and (change.factor - 1) * (other.factor - 1) < 0 and change.operation not in SHAPES:
                what = "the whole" if change.part == WHOLE else f"the {change.part}"
                raise PromptError(
                    f"{text!r} asks for more and for less of {what} at once.", advice="Leave one of them out."
                )
    return tuple(distinct)
