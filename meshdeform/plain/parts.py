"""Find the part that a word names, by all that is known of a body.

What people painted or renamed counts first; then the joints of a skeleton, the names of nodes and materials, and what
the body's reading found (`read_parts`), which weighed the same joints and names in. A body is read only where its file
does not tell. What nobody knows is missing: `PartMissingError` says why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from meshdeform.plain import names
from meshdeform.plain.body import UP, Body, Flags, Floats, Index
from meshdeform.plain.carried import touching
from meshdeform.plain.heads import Head, Tail, head_of_joints, head_of_reading, tail_of_joints, tail_of_reading
from meshdeform.plain.joints import OF_BODIES, JointParts
from meshdeform.plain.names import is_word, tokens
from meshdeform.plain.pieces import Limb, PartMissingError, Piece, attachment
from meshdeform.plain.read_parts import TOLD_APART, ReadParts
from meshdeform.plain.vocabulary import PART_NAMES, PART_OF
from meshdeform.plain.wording import is_one_edit_apart
from meshdeform.plain.words import part_and_sides
from meshdeform.vocabulary.nouns import NOUN_GROUPS

_INSIDE, _HALF = 0.5, 0.501
_FEWEST = 6
"""Vertices of an arm, at least."""
_FOOT, _JOINT_FOOT = 0.08, 0.22
"""Height of the feet, which keep their shape, as a share of that of the hips: of a reading, and of joints."""
_HIP = 10.0
"""Of the points where legs meet the body, the share in percent that may be below the hips."""
_ENDS = (2.0, 98.0)
"""Percentiles of the heights of a slab or a neck that are its ends: a few faces may be taken for it."""
LIVING = frozenset({*NOUN_GROUPS["animals"], *NOUN_GROUPS["figures"]})
"""Nouns of what has a belly and may have a skeleton."""
_KNOWN_WELL, _AGREED = 0.7, 0.35
"""Confidence of a part of the reading, and the share of it that joints must tell, with and without what belongs to it,
or else the reading counts: a robot whose joints are called "Foot" has legs above them."""
_OF_LEGS, _MOSTLY = frozenset({"leg", "foot", "thigh", "shin", "toe", "hip"}), 0.7
_LIMBS_OF = {
    **dict.fromkeys(("arm", "hand", "forearm", "finger"), frozenset({"arm", "hand", "wing", "claw"})),
    "wing": frozenset({"wing", "arm"}),
    "neck": frozenset({"neck", "head"}),
    "head": frozenset({"head"}),
    "tail": frozenset({"tail"}),
}
"""The parts of which a noun has one, if it has such a limb."""
_Part = TypeVar("_Part")


class _once(Generic[_Part]):  # noqa: N801 - like `cached_property`
    """A property that is looked for once: what is not there is missing each time for the same reason."""

    def __init__(self, find: Callable[[Any], _Part]) -> None:
        self._find, self.__doc__ = find, find.__doc__

    def __get__(self, parts: Any, _owner: type) -> _Part:
        if self._find not in parts.kept:
            try:
                parts.kept[self._find] = self._find(parts)
            except PartMissingError as missing:
                parts.kept[self._find] = missing
        value = parts.kept[self._find]
        if isinstance(value, PartMissingError):
            raise value.with_traceback(None)
        kept: _Part = value
        return kept


@dataclass(frozen=True)
class Legs:
    """What stands on the ground below a body."""

    hip: float  # height at which they end
    foot: float  # height up to which feet keep their shape
    weight: Floats  # (V,) float64
    limb: Index  # (V,) int64: the number of the leg nearest to each vertex
    names: tuple[str, ...]  # the name of the first joint of each leg, or empty
    found_by: str


class BodyLayer(NamedTuple):
    """A part between two heights."""

    low: float
    high: float
    found_by: str


class BodyParts:
    """The parts of one body; each is looked for once."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.kept: dict[Callable[[Any], Any], Any] = {}
        self._named: dict[str, Limb] = {}
        self.joints = JointParts(body)
        self.read = ReadParts(body)

    def own_names(self) -> list[str]:
        """Return the names, as words without sides, of nodes and materials that are parts of their own."""
        own = (name for name, each in self.body.names.items() if _is_part(each) and names.part_of(name) is None)
        named = (part_and_sides([word for word in tokens(name) if is_word(word)])[1] for name in own)
        return list(dict.fromkeys(name for name in named if name))

    @property
    def rigged(self) -> bool:
        """Whether joints tell limbs apart."""
        return self.joints.rigged

    @property
    def is_living(self) -> bool:
        """Whether it has a belly: by its skeleton, or because it was taken for an animal or a figure."""
        return self.rigged or self.read.noun in LIVING

    def is_told(self, word: str) -> bool:
        """Return whether joints, nodes or materials have the name of a part, or people gave it."""
        if self.read.is_given(word):
            return True
        try:
            self._named_in_file(word)
        except PartMissingError:
            return False
        return True

    def has(self, word: str) -> bool:
        """Return whether a part is told, or the reading found it."""
        return self.is_told(word) or (word in TOLD_APART and self.read.has(word))

    def faces(self, word: str) -> Flags | None:
        """Return the faces (F,) of a part that people or the reading told of, and of a neck of joints; else None."""
        if self.is_overruled(word):
            return self.read.faces(word)
        joints = self.joints.of_class(word) if word == "neck" else None
        if joints is not None and not self.read.is_given(word):
            return np.asarray(joints[self.body.faces].mean(1) > _INSIDE)
        if not self.read.is_given(word) and (self.is_told(word) or not self.read.has(word)):
            return None
        return self.read.faces(word)

    def foreign(self, word: str) -> bool:
        """Return whether joints tell a part that living things of its noun lack: a bear with the rig of a person."""
        ways = _LIMBS_OF.get(word)
        return ways is not None and self.read.noun in LIVING and not self.read.of_noun & ways

    def is_overruled(self, word: str) -> bool:
        """Return whether joints tell a part that the reading knows well, and elsewhere."""
        if self.read.is_given(word) or not self.is_told(word):
            return False
        told = self._named_in_file(word)
        return told.found_by == "joints" and self._overruled(word, np.asarray(told.weight > _INSIDE))

    def is_of_legs(self, word: str, inside: Flags) -> bool:
        """Return whether joints tell a part, by its faces (F,), where the reading knows well that legs are."""
        confidence = self.read.confidence("leg") if self.read.has("leg") else None
        if confidence is None or confidence < _KNOWN_WELL or word in _OF_LEGS:
            return False
        areas = np.linalg.norm(self.body.crosses, axis=1)
        return bool(areas[inside & self.read.faces("leg")].sum() > _MOSTLY * areas[inside].sum())

    def _overruled(self, word: str, told: Flags) -> bool:
        """Return whether the reading knows a part well, of which what joints tell, (V,), has little.

        Never if it is not sure of the noun: the head of a bird that is read backwards is its tail.
        """
        if not self.read.is_sure:
            return False
        confidence = self.read.confidence(word) if self.read.has(word) else None
        if confidence is None or confidence < _KNOWN_WELL:
            return False
        read, areas = self.read.faces(word), np.linalg.norm(self.body.crosses, axis=1)
        joints = told[self.body.faces].mean(1) > _INSIDE
        itself = self.read.itself(word)
        common = areas[read & joints].sum() / areas[read | joints].sum()
        covered = areas[itself & joints].sum() / max(float(areas[itself].sum()), 1e-300)
        return bool(min(common, covered) < _AGREED)

    # ---------------------------------------------------------------- limbs

    @_once
    def legs(self) -> Legs:
        """The legs.

        Raises PartMissingError: there are none.
        """
        if not self.read.is_given("leg"):
            standing = self.joints.standing_chains()
            told = np.asarray(sum((share for _, share in standing), np.zeros(len(self.body.points))) > _INSIDE)
            if standing and not self._overruled("leg", told):
                return self._legs_of_joints(standing)
            if standing:
                return self._legs_of_pieces(self.read.limb("leg"))
        return self._legs_of_pieces(self._limb("leg"))

    def _legs_of_joints(self, chains: list[tuple[int, Floats]]) -> Legs:
        body, shares = self.body, np.array([share for _, share in chains])
        # A foot may follow a control that hangs on the root: it belongs to legs that end above the ground.
        weight = body.smooth(np.minimum(shares.sum(0), 1), 3)
        between = (weight > 0.25) & (weight < 0.75)
        heights = body.points[between, UP] if between.any() else body.points[weight > _INSIDE, UP]
        hip = float(np.median(heights) if between.any() else np.percentile(heights, 95))
        foot = body.ground + _JOINT_FOOT * (hip - body.ground)
        limb = body.nearest([np.flatnonzero(share > _INSIDE) for share in shares])
        return Legs(hip, foot, weight, limb, tuple(body.joints[number].name for number, _ in chains), "joints")

    def _legs_of_pieces(self, limb: Limb) -> Legs:
        """Return legs that end where they meet the body, or, if they meet nothing, at their top."""
        body, pieces = self.body, limb.pieces
        own = np.zeros(len(body.points), bool)
        for piece in pieces:
            own[piece.rows] = True
        shares = limb.weight if limb.found_by == "names" else self.read.share(self.read.faces("leg"))
        own |= shares > _INSIDE
        meets = touching(body, own, ~own)
        top = float(np.percentile(meets[:, UP], _HIP)) if len(meets) else float(body.points[own, UP].max())
        hip = max(top, body.ground + 1e-9 * body.diagonal)
        weight = np.where(own, 1.0, shares)
        numbers = body.nearest([piece.rows for piece in pieces])
        foot = body.ground + _FOOT * (hip - body.ground)
        return Legs(hip, foot, weight, numbers, tuple(piece.name for piece in pieces), limb.found_by)

    def leg_pieces(self) -> Limb:
        """Return the legs one by one.

        Raises PartMissingError: there are none.
        """
        body, legs, pieces = self.body, self.legs, []
        for number in np.unique(legs.limb[legs.weight > _INSIDE]):
            weight = np.where(legs.limb == number, legs.weight, 0)
            own = weight > _INSIDE
            top = body.points[own & (body.points[:, UP] > legs.hip - 0.2 * (legs.hip - body.ground))]
            pivot = (top if len(top) else body.points[own]).mean(0)
            pivot[UP] = legs.hip
            pieces.append(Piece(body, weight, pivot, legs.names[number]))
        return Limb(body, pieces, legs.found_by)

    @_once
    def arms(self) -> Limb:
        """The arms.

        Raises PartMissingError: there are none.
        """
        body, pieces = self.body, []
        for number, share in [] if self.read.is_given("arm") else self.joints.chains("arm"):
            weight = body.smooth(share, 2)
            if (weight > _INSIDE).sum() >= _FEWEST:
                pieces.append(Piece(body, weight, attachment(body, weight), body.joints[number].name))
        limb = Limb(body, pieces, "joints")
        return limb if pieces and not self._overruled("arm", limb.weight > _INSIDE) else self._limb("arm")

    @_once
    def head(self) -> Head:
        """The head.

        Raises PartMissingError: there is none.
        """
        others = self.read.is_given("head") or self.is_overruled("head")
        head = None if others else head_of_joints(self.body, self.joints)
        return head or head_of_reading(self.body, self.read)

    @_once
    def tail(self) -> Tail:
        """The tail.

        Raises PartMissingError: there is none.
        """
        others = self.read.is_given("tail") or self.is_overruled("tail")
        tail = None if others else tail_of_joints(self.body, self.joints)
        return tail or tail_of_reading(self.body, self.read)

    # ---------------------------------------------------------------- things

    @_once
    def wheels(self) -> Limb:
        """The wheels one by one, each about its own middle.

        Raises PartMissingError: there are none.
        """
        body = self.body
        if self.read.is_given("wheel"):
            return self.read.limb("wheel")
        named = [(name, flags) for name, flags in body.names.items() if names.part_of(name) == "wheel"]
        named = [(name, flags) for name, flags in named if _is_part(flags)]
        pieces, taken = [], np.zeros(len(body.points), bool)
        for name, flags in sorted(named, key=lambda source: int(source[1].sum())):
            for own in body.groups(flags & ~taken):  # a node of a wheel, and its material
                weight = np.zeros(len(taken))
                weight[own] = 1.0
                middle = (body.points[own].max(0) + body.points[own].min(0)) / 2
                pieces.append(Piece(body, weight, middle, name))
                taken[own] = True
        return Limb(body, pieces, "names") if pieces else self.read.limb("wheel")

    @property
    def on_wheels(self) -> bool:
        """Whether it has wheels."""
        return not self.rigged and _is_there(lambda: self.wheels)

    @property
    def on_legs(self) -> bool:
        """Whether it stands on legs."""
        return _is_there(lambda: self.legs)

    def slab(self, word: str) -> BodyLayer:
        """Return a seat or the top of a table, which of them is there.

        Raises PartMissingError: it has neither.
        """
        if self.rigged and not self.read.is_given(word):
            raise PartMissingError("A body with a skeleton has no seat.")
        other = "top" if word == "seat" else "seat"
        return self._layer(self._limb(other if not self.has(word) and self.has(other) else word))

    @_once
    def back(self) -> Limb:
        """The back of a seat.

        Raises PartMissingError: there is none.
        """
        return self._limb("back")

    @_once
    def bottle_neck(self) -> BodyLayer:
        """The neck of a bottle.

        Raises PartMissingError: it has none.
        """
        return self._layer(self._limb("neck"))

    def _layer(self, limb: Limb) -> BodyLayer:
        heights = np.concatenate([self.body.points[piece.rows, UP] for piece in limb.pieces])
        low, high = np.percentile(heights, _ENDS)
        return BodyLayer(float(low), float(high), limb.found_by)

    # ---------------------------------------------------------------- by name

    def named(self, word: str) -> Limb:
        """Return the part that has a name, in the file or by the reading.

        Raises PartMissingError: none has it, or all of the asset does.
        """
        return self._limb(word)

    def _limb(self, word: str) -> Limb:
        if self.read.is_given(word):
            return self.read.limb(word)
        if word == "back" and self.rigged:
            raise PartMissingError("The back of a body is no part that can be changed.")
        try:
            told = self._named_in_file(word)
        except PartMissingError:
            if word not in TOLD_APART:
                raise
            return self.read.limb(word)
        return self.read.limb(word) if self.is_overruled(word) else told

    def _named_in_file(self, word: str) -> Limb:
        """Return the part that joints, nodes or materials with this name make."""
        if word not in self._named:
            pieces, found_by = self.joints.pieces(word), "joints"
            if not pieces and not (self.rigged and word in OF_BODIES):
                pieces, found_by = self._pieces_of_names(word), "names"
            self._named[word] = Limb(self.body, pieces, found_by)
        if not self._named[word].pieces:
            raise PartMissingError(f"No part called {word!r} was found.")
        return self._named[word]

    def spelled(self, word: str) -> str:
        """Return a part of a sentence as the file spells it: of a name that it lacks, the only one a letter off."""
        if word in PART_NAMES or self.is_told(word):
            return word
        known = [*self.own_names(), *(part for part in PART_OF if self.is_told(PART_OF[part]))]
        near = {PART_OF.get(each, each) for each in known if is_one_edit_apart(word, each)}
        return near.pop() if len(near) == 1 else word

    def _pieces_of_names(self, word: str) -> list[Piece]:
        """Return a piece for each group of vertices of the nodes and materials that a word names."""
        body = self.body
        taken = np.zeros(len(body.points), bool)
        pieces = []
        chosen = [(name, each) for name, each in body.names.items() if names.means(name, word) and _is_part(each)]
        for name, each in sorted(chosen, key=lambda pair: int(pair[1].sum())):
            flags = each & ~taken
            taken |= each
            smoothed = body.smooth(flags.astype(float), 2)
            # Components that belong to it in whole are not blended with what they merely touch.
            whole = np.bincount(body.components, ~flags)[body.components] == 0
            weight = np.where(whole & flags, 1.0, np.where(flags, np.maximum(smoothed, _HALF), smoothed * ~whole))
            groups = body.groups(weight > _INSIDE)
            nearest = body.nearest(groups)
            for number in range(len(groups)):
                own = np.where(nearest == number, weight, 0)
                pivot = attachment(body, flags.astype(float) if len(groups) == 1 else own)
                pieces.append(Piece(body, own, pivot, name))
        return [piece for piece in pieces if len(piece.rows)]

    # ---------------------------------------------------------------- front

    @cached_property
    def forward(self) -> int:
        """The sign of the front on its axis: as names say, else as the reading found it."""
        if self.body.named_front is not None:
            return self.body.named_front[1]
        front = self.body.read_front
        return 1 if front is None else front[1]


def _is_part(flags: Flags) -> bool:
    return bool(flags.any() and not flags.all())


def _is_there(find: Callable[[], object]) -> bool:
    try:
        find()
    except PartMissingError:
        return False
    return True
