"""List the parts that words can name on a body, each with its triangles and the operations that suit it.

A part is listed only if sentences with its name are read as changes of just that part, and can be carried out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from meshdeform.errors import PromptError
from meshdeform.plain.body import Body, Floats, Index
from meshdeform.plain.change import calibrated, meant
from meshdeform.plain.maps import move
from meshdeform.plain.moved import Moved
from meshdeform.plain.parts import Parts
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.table import OF_PARTS, WHOLE, direction
from meshdeform.plain.vocabulary import PART_NAMES
from meshdeform.plain.words import Change, Sentence

_TRIED = ("fat", "tall", "long", "big", "wide", "deep", "high")
"""Operations on parts; of those that come to the same, the first counts."""
_TRIALS = (0.7, 1.3)
_FEWEST_NAMES, _MOST_NAMES, _MOST_TRIED = 4, 64, 500_000
"""How many names of the file are tried: so many vertices, between a few and many."""
_INSIDE = 0.5


@dataclass(frozen=True)
class NamedPart:
    """A part that words can name on a body."""

    name: str  # as in a sentence: `legs`
    found_by: str  # `joints`, `names`, `components` or `geometry`
    weight: Floats  # (V,) float64: how much each vertex belongs to it
    operations: tuple[str, ...]  # those of `words.OF_PARTS` that suit it

    def faces(self, corners: Index) -> list[int | list[int]]:
        """Return the triangles that belong to it, as a region has them: numbers, and ranges with both ends.

        `corners`, (T, 3) int64: vertices of the triangles, -1 where the body has none.
        """
        inside = (corners >= 0).all(1) & (self.weight[corners].mean(1) > _INSIDE)
        ends = np.flatnonzero(np.diff(inside, prepend=False, append=False)).reshape(-1, 2)
        return [int(first) if last == first + 1 else [int(first), int(last) - 1] for first, last in ends]


def find_parts(body: Body, read: Callable[[str], Sentence | None], sentence: Sentence | None = None) -> list[NamedPart]:
    """Return the parts that words can name on a body: those that everybody knows, then names of nodes and materials.

    `read`: reads a sentence: a name is left out that is not read as the name of its part; `sentence`: only parts in it.
    """
    parts = Parts(body)
    most = min(_MOST_NAMES, max(_FEWEST_NAMES, _MOST_TRIED // len(body.points)))
    own = [name for name in parts.own_names() if name not in PART_NAMES][:most]
    named = {**PART_NAMES, **{name: name for name in own}}
    if sentence is not None:
        named = {each.part: named.get(each.part, each.part) for each in meant(body, sentence) if each.part != WHOLE}
    results: dict[str, NamedPart] = {}
    for part, name in named.items():
        each = _find_part(parts, part, name, read)
        # Everything has a lowest end: only that of a bottle is listed. A body that has no such name is the belly.
        hidden = part == "base" and each is not None and each.found_by == "geometry" and not parts.is_bottle
        hidden |= part == "body" and not parts.is_named("body")
        if each is None or (hidden and sentence is None) or any(_same(each, other) for other in results.values()):
            continue
        results[part] = each
    if "seat" in results and "back" not in results and "top" not in results:
        results["seat"] = replace(results["seat"], name="top")
    if sentence is not None:
        return list(results.values())
    return _apart([each for part, each in results.items() if _is_evident(parts, part, results)])


def _apart(found: list[NamedPart]) -> list[NamedPart]:
    """Return parts that share no vertex: what several have belongs to one with a name, then to the smallest."""
    sizes = [(each.found_by == "geometry", int((each.weight > _INSIDE).sum())) for each in found]
    taken, own = np.zeros(len(found[0].weight) if found else 0, bool), dict[int, NamedPart]()
    for number in sorted(range(len(found)), key=sizes.__getitem__):
        weight = np.where(taken, 0.0, found[number].weight)
        taken |= weight > _INSIDE
        if (weight > _INSIDE).any():
            own[number] = replace(found[number], weight=weight)
    return [own[number] for number in sorted(own)]


def _is_evident(parts: Parts, part: str, named: Mapping[str, NamedPart]) -> bool:
    """Return whether a part is what its name says: a ball has a lower end that is no leg, and no tail."""
    # Legs are several, or one below a table; a tail is that of something that has a front, and legs or a head.
    if named[part].found_by != "geometry" or part not in ("leg", "seat", "top", "back", "tail"):
        return True
    stands = "leg" in named and (parts.legs.count > 1 or ("seat" in named and "back" not in named))
    return stands if part != "tail" else not parts.body.either and (stands or "head" in named)


def _same(one: NamedPart, other: NamedPart) -> bool:
    return np.array_equal(one.weight > _INSIDE, other.weight > _INSIDE)


def _find_part(parts: Parts, part: str, name: str, read: Callable[[str], Sentence | None]) -> NamedPart | None:
    """Return a part with the operations that suit it; None if there is none by this name."""
    moved: dict[str, Moved] = {}
    for operation in _TRIED:
        if direction(operation, part) is None:
            continue
        change = Change(operation, part, 1.0)
        if not all(_is_read(parts.body, f"{name} {word} by 30 %", change, read) for word in OF_PARTS[operation]):
            continue
        try:
            for factor in _TRIALS:
                tried = move(parts, change, calibrated(parts, replace(change, factor=factor)))
        except PartMissingError:
            continue
        if tried.found_by and not any(np.array_equal(tried.points, other.points) for other in moved.values()):
            moved[operation] = tried
    if not moved:
        return None
    first = next(iter(moved.values()))
    inside = first.weight > _INSIDE
    if inside.all() or not inside.any():
        return None
    return NamedPart(name, first.found_by, first.weight, tuple(each for each in OF_PARTS if each in moved))


def _is_read(body: Body, text: str, change: Change, read: Callable[[str], Sentence | None]) -> bool:
    """Return whether a sentence asks for one change, with the operation and the part of another."""
    try:
        sentence = read(text)
    except PromptError:  # a name with words for opposites
        return False
    changes = () if sentence is None else meant(body, sentence)
    return [(each.operation, each.part) for each in changes] == [(change.operation, change.part)]
