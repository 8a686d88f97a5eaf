"""Weigh in what a file says of its parts: joints and names of nodes and materials.

A class of joints that moves the share s of a cell multiplies the probability of the parts of that class by 0.05 + s,
that of the others by 1.05 - s. What joints or names tell and the members lack, such as the neck of a person, has half
of what the parts of its class lack to 1. A name that means a part multiplies all others by 0.02 where it stands, and
its own by 0.1 elsewhere if it names all there is of it, as of wheels. What most of an asset is named after is likely
its noun.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from meshdeform.nouns.labels import Flags, Floats, Index, code
from meshdeform.reading.cells import Cells
from meshdeform.vocabulary.lookup import noun_of
from meshdeform.vocabulary.near_words import nearest
from meshdeform.vocabulary.nouns import NOUN_GROUPS, NOUNS
from meshdeform.vocabulary.solids import PART_NAMES, parent_of, parts_of
from meshdeform.words.in_use import like_of

__all__ = ["Evidence", "nouns_named", "weighed"]

_JOINTS = {
    "head": "head ear nose horn trunk tusk mane beak eye crest wattle mouth",
    "neck": "neck mane",
    "leg": "leg foot",
    "arm": "arm hand wing leg claw",
    "hand": "hand claw",
    "foot": "foot",
    "tail": "tail",
    "ear": "ear",
}
JOINT_PARTS: dict[str, frozenset[str]] = {name: frozenset(parts.split()) for name, parts in _JOINTS.items()}
"""The parts that joints of a class move."""

_MEANS: dict[str, str] = {
    "feet": "foot", "hair": "head", "helmet": "head", "rooftile": "roof", "shoe": "foot", "tire": "wheel",
    "tyre": "wheel", "snout": "nose", "muzzle": "nose", "paw": "foot", "hoof": "foot", "leaves": "leaf",
    "antler": "horn", "tyres": "wheel", "rotors": "rotor", "propellor": "propeller", "lampshade": "shade",
}  # fmt: skip
_NOT_PARTS = frozenset(("body", "base", "top", "point", "line", "text", "band", "door", "frame", "panel", "axle"))
_ALL_NAMED = ("wheel", "shade")
_OTHERS, _ELSEWHERE = 0.02, 0.1
_SHAPES = frozenset(("bone", "bones", "box", "cone", "plane"))
"""Words in names that are nouns, but mostly mean a joint or a plain solid that somebody began with."""
_EDITORS = (
    "armature base body box circle cleaner cloth color colors cylinder export geometry glass group light mat material"
    " mesh metal model node object paint part plastic rock root scene shape skin sphere stone surface texture wall wire"
    " wood"
)
_OF_EDITORS = frozenset(_EDITORS.split())
"""Words in names that editors give, and of what things are made."""
_MOST_NEAR = 4
_MOST_OF_IT = 0.45
"""Share of the area that what is named as a noun has at least: a helmet is no person."""
_BESIDE = {"head": "neck"}
"""What a piece of a file that is named after a part may hold besides."""
_MOST_NAMES = 40
_NEVER_FINS = frozenset(JOINT_PARTS) - {"arm", "leg"}
"""Classes of joints that move parts of that name alone: what a dolphin calls arms are fins."""
_MOVED = 0.5
"""Share from which a joint moves something at all."""
_LACKING = 0.2
"""Probability, on what joints of a class move, under which the members lack its parts."""
_PARTS_OF_GROUP: dict[str, frozenset[str]] = {
    noun: frozenset(part for other in nouns for part in parts_of(other))
    for nouns in NOUN_GROUPS.values()
    for noun in nouns
}
"""The parts that any noun of the same group has."""


@dataclass(frozen=True)
class Evidence:
    """What a file says of the V vertices of an asset.

    `joints`: how much (V,) float64 each vertex follows the joints of a class (`head`, `neck`, `leg`, `arm`, `tail`,
    `ear`); `names`: the vertices (V,) bool of each named node or material.
    """

    joints: Mapping[str, Floats] = field(default_factory=dict)
    names: Mapping[str, Flags] = field(default_factory=dict)

    def segments(self, faces: Index) -> Index:
        """Return a number (F,) for each face that differs where a node or a material ends."""
        number = np.zeros(len(faces), np.int64)
        for flags in list(self.names.values())[:_MOST_NAMES]:
            number = number * 2 % (2**60 - 1) + flags[faces].all(1)
        return number

    def told(self, faces: Index) -> dict[str, Flags]:
        """Return the faces (F,) of each part that names tell."""
        told: dict[str, Flags] = {}
        for name, flags in self.names.items():
            part = part_meant(name)
            if part is not None and flags.any() and not flags.all():
                told[part] = told.get(part, np.zeros(len(faces), bool)) | flags[faces].all(1)
        return {part: flags for part, flags in told.items() if flags.any() and flags.mean() < 0.9}


def nouns_named(evidence: Evidence, faces: Index, areas: Floats) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the nouns that names of nodes or materials tell, and those near to other words of them: car of Jeep.

    `areas` (F,) of the faces. Both by the alphabet; the second ones only where nothing is named outright.
    """
    least = _MOST_OF_IT * float(areas.sum())
    words: set[str] = set()
    for name, flags in list(evidence.names.items())[:_MOST_NAMES]:
        if float(areas[flags[faces].all(1)].sum()) >= least:
            words |= {word for word in _words(name) if word not in _SHAPES}
    named = {noun for word in words if (noun := noun_of(word)) is not None}
    telling = {word.removesuffix("s") for word in words - _OF_EDITORS} - set(PART_NAMES)
    near = set() if named else {noun for word in telling for noun in nearest(word, NOUNS)}
    return tuple(sorted(named)), tuple(sorted(near)) if len(near) <= _MOST_NEAR else ()


def _words(name: str) -> list[str]:
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def part_meant(name: str) -> str | None:
    """Return the part that the name of a node or a material means, or None."""
    words = _words(name)
    if {"door", "axle", "axis"} & set(words):
        return None
    for word in words:
        for form in (word, word.removesuffix("s"), _MEANS.get(word, ""), _MEANS.get(word.removesuffix("s"), "")):
            if form in PART_NAMES and form not in _NOT_PARTS:
                return form
    return None


def parts_told(evidence: Evidence, faces: Index, noun: str, present: Index) -> Index:
    """Return the parts, indices in `PART_NAMES`, that names tell, and joints where no part of their class is present.

    They are parts that nouns of its group have; `present`: the parts of the members.
    """
    names = {PART_NAMES[number] for number in present}
    moved = {part for part, shares in evidence.joints.items() if shares.max() > _MOVED and part in _NEVER_FINS}
    told = {part for part in moved if not JOINT_PARTS[part] & names} | set(evidence.told(faces))
    return np.array([code(part) for part in sorted(told & _PARTS_OF_GROUP.get(like_of(noun), told))], np.int64)


def weighed(
    probabilities: Floats, parts: Index, evidence: Evidence, faces: Index, cells: Cells, areas: Floats
) -> Floats:
    """Return probabilities (C, P) of parts with what the file says multiplied in; `areas` (F,) of the faces."""
    names = [PART_NAMES[number] for number in parts]
    weighed_in = probabilities.copy()
    for joint_class, moved in JOINT_PARTS.items():
        shares = evidence.joints.get(joint_class)
        own = np.array([name in moved for name in names])
        if shares is None or shares.max() <= _MOVED or not own.any():
            continue
        share = cells.mean(shares[faces].mean(1), areas)[:, None]
        moved_most = share[:, 0] > _MOVED
        if joint_class in names and moved_most.any() and weighed_in[moved_most][:, own].sum(1).mean() < _LACKING:
            _raise(weighed_in, names.index(joint_class), share[:, 0], own)
        weighed_in *= np.where(own[None], 0.05 + share, 1.05 - share)
    for part, flags in evidence.told(faces).items():
        if part not in names:
            continue
        own = np.array([name in (part, _BESIDE.get(part)) or parent_of(name, names) == part for name in names])
        there = (cells.mean(flags.astype(float), areas) > 0.5)[:, None]
        _raise(weighed_in, names.index(part), there[:, 0].astype(float), own)
        weighed_in *= np.where(there & ~own[None], _OTHERS, 1.0)
        if part in _ALL_NAMED:
            weighed_in *= np.where(~there & (np.array(names) == part)[None], _ELSEWHERE, 1.0)
    return np.asarray(weighed_in / np.maximum(weighed_in.sum(1, keepdims=True), 1e-12))


def _raise(probabilities: Floats, column: int, share: Floats, own: Flags) -> None:
    """Give a part, in place, half of what the parts of its class lack to 1, times a share (C,)."""
    lack = np.maximum(1 - probabilities[:, own].sum(1), 0)
    probabilities[:, column] += 0.5 * share * lack
