"""List the parts that words can name on a body, each with its faces and the operations that suit it.

A part is listed only if sentences with its name are read as changes of just that part, and can be carried out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from meshdeform.errors import PromptError
from meshdeform.plain.body import Body, Flags, Floats, Index
from meshdeform.plain.change import calibrated, meant_of
from meshdeform.plain.maps import move
from meshdeform.plain.moved import Moved
from meshdeform.plain.parts import BodyParts
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.read_parts import GIVEN, READ
from meshdeform.plain.table import OF_PARTS, WHOLE, direction
from meshdeform.plain.vocabulary import PART_NAMES, STUFFS
from meshdeform.plain.words import Change, Sentence

_TRIED = ("fat", "tall", "long", "big", "wide", "deep", "high")
"""Operations on parts; of those that come to the same, the first counts."""
_TRIAL = 1.3
_FEWEST_NAMES, _MOST_NAMES, _MOST_TRIED = 16, 64, 2_000_000
"""How many names of the file are tried: so many vertices, between a few and many."""
_ONE_TRIAL = 50_000
"""Vertices from which one operation of a part is tried, and the others are taken from the table."""
_INSIDE = 0.5
_LEFT, _LEFT_OF_KNOWN, _WITHIN = 0.5, 0.05, 0.8
"""Shares of the area of a name of the file, and of a part that everybody knows, that others must leave of it; share of
what a name has of other parts, from which it lies within one of them."""
_EVERYBODYS = frozenset(PART_NAMES.values())
_LAST = frozenset({PART_NAMES["body"]})
_DETAILS = {
    "thigh": "leg", "shin": "leg", "toe": "leg", "forearm": "arm", "finger": "hand", "hip": "leg", "shoulder": "arm",
}  # fmt: skip
"""Parts that words may name, and that are not listed beside the one in which they are."""


@dataclass(frozen=True)
class NamedPart:
    """A part that words can name on a body."""

    name: str  # as in a sentence: `legs`; if people named it, as they call it
    found_by: str  # `given`, `joints`, `names` or `shapes`
    inside: Flags  # (F,) bool: the faces of the body that belong to it
    operations: tuple[str, ...]  # those of `words.OF_PARTS` that suit it
    confidence: float | None = None  # 0 to 1, of what the shapes of the noun tell

    def faces(self, corners: Index) -> list[int | list[int]]:
        """Return the triangles that belong to it, as a region has them: numbers, and ranges with both ends.

        `corners`, (T, 3) int64: vertices of the triangles, -1 where the body has none; those with three vertices are
        the body's faces, in order.
        """
        inside = np.zeros(len(corners), bool)
        inside[np.flatnonzero(faces_among(corners))] = self.inside
        ends = np.flatnonzero(np.diff(inside, prepend=False, append=False)).reshape(-1, 2)
        return [int(first) if last == first + 1 else [int(first), int(last) - 1] for first, last in ends]


def faces_among(corners: Index) -> Flags:
    """Return which triangles (T,) with these vertices (T, 3) are faces of a body: those that are no line or point."""
    return np.asarray((corners >= 0).all(1) & (corners != np.roll(corners, 1, axis=1)).all(1))


def find_parts(body: Body, read: Callable[[str], Sentence | None], sentence: Sentence | None = None) -> list[NamedPart]:
    """Return the parts that words can name on a body: those that everybody knows, then those that it alone has.

    `read`: reads a sentence: a name is left out that is not read as the name of its part; `sentence`: only parts in it.
    No two of all parts share a face.
    """
    body = body.upright()
    parts = BodyParts(body)
    most = min(_MOST_NAMES, max(_FEWEST_NAMES, _MOST_TRIED // len(body.points)))
    telling = [name for name in parts.own_names() if _is_telling(name)]
    own = [name for name in [*parts.read.names, *telling[:most]] if name not in PART_NAMES]
    named = {**PART_NAMES, **{name: name for name in own}}
    if sentence is not None:
        named = {each.part: named.get(each.part, each.part) for each in meant_of(parts, sentence) if each.part != WHOLE}
    else:
        named = {part: name for part, name in named.items() if not _is_hidden(parts, part)}
    results: list[NamedPart] = []
    for part, name in named.items():
        each = _find_part(parts, part, _called(parts, part, name, read), read)
        if each is not None and not any(np.array_equal(each.inside, other.inside) for other in results):
            results.append(each)
    return results if sentence is not None else _disjoint(body, results)


def _is_telling(name: str) -> bool:
    """Return whether a name of the file says what something is: words, and none of what things are made of."""
    return not STUFFS & set(name.split())


def _is_hidden(parts: BodyParts, part: str) -> bool:
    """Return whether a part is not listed, though words may name it: a lowest end, a belly, a wing of a dolphin."""
    if part == "belly" or (parts.read.is_sure and not parts.read.is_given(part) and parts.foreign(part)):
        return True
    if part in ("base", "seat", "top", "neck"):
        # A body has a neck by its joints, and its lower and its upper side are none of the others.
        return (not parts.has(part) or parts.is_living) if part != "neck" else not (parts.has(part) or parts.rigged)
    if parts.read.by_another_name(part):
        return not parts.is_told(part)
    if part in _DETAILS:
        return parts.has(_DETAILS[part]) and not parts.read.is_given(part)
    return part == "body" and parts.is_living and not parts.is_told("body")


def _disjoint(body: Body, named: list[NamedPart]) -> list[NamedPart]:
    """Return parts that share no face.

    What several have belongs to what people gave, else to the smallest: a nose takes its faces from a head. Names that
    the file alone knows, such as those of materials, count likewise within a part, and last across several; so does the
    body, which is what is left. What others leave too little of is left out.
    """
    areas = np.linalg.norm(body.crosses, axis=1)
    sizes = [float(areas[each.inside].sum()) for each in named]
    ranks = [_precedence(each, named, areas) for each in named]
    taken, own = np.zeros(len(areas), bool), dict[int, NamedPart]()
    for number in sorted(range(len(named)), key=lambda number: (ranks[number], sizes[number])):
        inside = named[number].inside & ~taken
        if inside.any() and areas[inside].sum() >= _least_left(named[number]) * sizes[number]:
            own[number] = replace(named[number], inside=inside)
            taken |= inside
    return [own[number] for number in sorted(own)]


def _precedence(part: NamedPart, named: list[NamedPart], areas: Floats) -> int:
    """Return which parts take their faces before others do."""
    if part.found_by == GIVEN:
        return 0
    if part.name in _LAST:
        return 3
    if part.name in _EVERYBODYS or part.found_by == READ:
        return 1
    others = [each.inside for each in named if each is not part and each.name in _EVERYBODYS - _LAST]
    within = max((float(areas[part.inside & inside].sum()) for inside in others), default=0.0)
    touched = float(areas[part.inside & np.logical_or.reduce([*others, np.zeros(len(areas), bool)])].sum())
    return 1 if touched <= 0 or within >= _WITHIN * touched else 2


def _least_left(part: NamedPart) -> float:
    """Return the share of its area that a part keeps at least, to be listed."""
    if part.found_by in (GIVEN, READ):
        return 0.0
    return _LEFT_OF_KNOWN if part.name in _EVERYBODYS else _LEFT


def _called(parts: BodyParts, part: str, name: str, read: Callable[[str], Sentence | None]) -> str:
    """Return what people called a part, if sentences with that are read as changes of all of it; else its name."""
    said = parts.read.said.get(part, name)
    changes = () if said == name else _changes(parts, f"{said} {OF_PARTS['big'][0]} by 30 %", read)
    return said if [(each.part, each.sides) for each in changes] == [(part, ())] else name


def _find_part(parts: BodyParts, part: str, name: str, read: Callable[[str], Sentence | None]) -> NamedPart | None:
    """Return a part with the operations that suit it; None if there is none by this name."""
    body, moved, operations = parts.body, dict[str, Moved](), list[str]()
    for operation in _TRIED:
        if direction(operation, part) is None:
            continue
        change = Change(operation, part, 1.0)
        if not all(_is_read(parts, f"{name} {word} by 30 %", change, read) for word in OF_PARTS[operation]):
            continue
        if moved and len(body.points) > _ONE_TRIAL:
            operations.append(operation)
            continue
        try:
            tried = move(parts, change, calibrated(parts, replace(change, factor=_TRIAL)))
        except PartMissingError:
            continue
        if tried.found_by and not any(np.array_equal(tried.points, other.points) for other in moved.values()):
            moved[operation] = tried
            operations.append(operation)
    if not moved:
        return _unchangeable(parts, part, name)
    first = next(iter(moved.values()))
    inside = parts.faces(part)
    if inside is None:
        inside = np.asarray(first.weight[body.faces].mean(1) > _INSIDE)
    if inside.all() or not inside.any():
        return None
    if first.found_by == "names" and part in ("base", "top") and _is_most(body, inside):
        return None
    if first.found_by == "joints" and parts.is_of_legs(part, inside):
        return None
    suits = tuple(each for each in OF_PARTS if each in operations)
    confidence = parts.read.confidence(part) if first.found_by == READ else None
    return NamedPart(name, first.found_by, inside, suits, confidence)


def _is_most(body: Body, inside: Flags) -> bool:
    """Return whether faces are most of the surface: a node "base" of a van is no foot of it."""
    areas = np.linalg.norm(body.crosses, axis=1)
    return bool(areas[inside].sum() > 0.5 * areas.sum())


def _unchangeable(parts: BodyParts, part: str, name: str) -> NamedPart | None:
    """Return a part that was found and that no operation can change, as of an ear of one triangle; else None."""
    inside = parts.faces(part)
    if inside is None or inside.all() or not inside.any():
        return None
    return NamedPart(name, parts.read.found_by(part), inside, (), parts.read.confidence(part))


def _is_read(parts: BodyParts, text: str, change: Change, read: Callable[[str], Sentence | None]) -> bool:
    """Return whether a sentence asks for one change, with the operation and the part of another."""
    changes = _changes(parts, text, read)
    return [(each.operation, each.part) for each in changes] == [(change.operation, change.part)]


def _changes(parts: BodyParts, text: str, read: Callable[[str], Sentence | None]) -> tuple[Change, ...]:
    """Return the changes that a sentence asks for; none if it cannot be read."""
    try:
        sentence = read(text)
    except PromptError:  # a name with words for opposites
        return ()
    return () if sentence is None else meant_of(parts, sentence)
