"""Tell parts by the joints of a skeleton: which limb each joint is of, and which vertices follow it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cached_property

import numpy as np

from meshdeform.plain import names
from meshdeform.plain.body import UP, Body, Floats, Index
from meshdeform.plain.names import tokens
from meshdeform.plain.pieces import Piece, attachment

_CLASSES = {
    **dict.fromkeys(("face", "tongue"), "head"),
    **dict.fromkeys(("knee", "ankle"), "leg"),
    **dict.fromkeys(("middle", "ring", "clavicle", "palm"), "arm"),
}
"""The class of joints whose names are no part in a sentence."""
_CLASS_OF = {
    **dict.fromkeys(("leg", "thigh", "shin", "foot", "toe"), "leg"),
    **dict.fromkeys(("arm", "forearm", "hand", "finger", "wing"), "arm"),
    **dict.fromkeys(("head", "eye", "jaw", "nose", "beak", "hair", "mane", "horn", "trunk"), "head"),
    **dict.fromkeys(("ear",), "ear"),
    **dict.fromkeys(("neck",), "neck"),
    **dict.fromkeys(("tail",), "tail"),
}
"""The class of limbs that each part of a body belongs to."""
OF_BODIES = frozenset({*_CLASS_OF, "belly", "body", "back", "shoulder", "hip"}) - {
    "hair",
    "mane",
    "eye",
    "nose",
    "beak",
    "horn",
    "trunk",
}
"""Parts of bodies that a skeleton has: where there is one, names of clothes say nothing about them."""
_WITH_ALL_BELOW = frozenset({"leg", "arm", "head", "tail", "ear", "wing", "hand", "foot"})
"""Parts to which all joints below theirs belong; what hangs on others is carried."""
_FINGERS = frozenset({"index", "middle", "ring", "pinky", "little", "thumb"})
_HELPERS = frozenset({"ik", "pole", "target", "control", "ctrl"})
_INSIDE, _MOSTLY = 0.5, 0.6
_NEAR_GROUND, _LEAST_HEIGHT = 0.15, 0.05
"""Heights, as shares of the whole, below which a leg that stands begins, and which it has at least."""


_OF_PEOPLE = ("head", "arm(?!at)|hand(?!le)", "leg|thigh|foot")
_OF_ANIMALS = "tail|wing|front|paw|hoof"
"""In the names of joints: of a person, and of nobody."""


def is_person(joints: Iterable[str]) -> bool:
    """Return whether joints with these names are those of a person."""
    found = " ".join(joints).lower()
    return all(re.search(part, found) for part in _OF_PEOPLE) and not re.search(_OF_ANIMALS, found)


class JointParts:
    """The joints of one body by the limbs that they are of."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self._kinds: list[str] = []

    def of_class(self, name: str) -> Floats | None:
        """Return how much each vertex (V,) follows the joints of a class, such as `leg`; None without such joints."""
        return self._classes.get(name)

    @property
    def rigged(self) -> bool:
        """Whether joints tell limbs apart."""
        return len(self._classes) > 1

    @cached_property
    def _classes(self) -> dict[str, Floats]:
        joints = self.body.joints
        kinds: list[str] = []
        for joint in joints:
            words = tokens(joint.name)
            kind = "leg" if "paw" in words else _CLASS_OF.get(names.part_of(joint.name) or "", "")
            kind = kind or next((_CLASSES[word] for word in words if word in _CLASSES), "")
            squeezed = re.search(r"thigh|foot|leg|arm|hand|neck|wing|flipper", joint.name.lower())
            if not kind and squeezed:
                kind = _CLASS_OF.get(squeezed[0], "arm")
            kinds.append("body" if _HELPERS & set(words) and not kind else kind)
        for number, joint in enumerate(joints):  # a bone that has no telling name belongs to the limb above it
            if not kinds[number]:
                at = joint.parent
                while at >= 0 and not kinds[at]:
                    at = joints[at].parent
                kinds[number] = kinds[at] if at >= 0 and kinds[at] not in ("neck",) else "body"
        self._kinds = kinds
        columns = np.array(kinds)
        return {kind: self._share(np.flatnonzero(columns == kind)) for kind in dict.fromkeys(kinds)}

    def chains(self, kind: str) -> list[tuple[int, Floats]]:
        """Return the first joint of each chain of a class, and how much each vertex (V,) follows the chain."""
        body = self.body
        if self.of_class(kind) is None:
            return []
        chains = []
        for number, joint in enumerate(body.joints):
            if self._kinds[number] == kind and (joint.parent < 0 or self._kinds[joint.parent] != kind):
                below = [n for n in range(len(body.joints)) if self._kinds[n] == kind and self._is_below(n, number)]
                chains.append((number, self._share(np.array(below))))
        return chains

    def standing_chains(self) -> list[tuple[int, Floats]]:
        """Return the chains of leg joints that reach the ground."""
        body, chains = self.body, []
        for number, share in self.chains("leg"):
            own = body.points[share > 0.5, UP]
            high = body.size[UP]
            if len(own) and own.min() < body.ground + _NEAR_GROUND * high and np.ptp(own) > _LEAST_HEIGHT * high:
                chains.append((number, share))
        return chains

    def _is_below(self, number: int, root: int) -> bool:
        while number >= 0 and number != root:
            number = self.body.joints[number].parent
        return number == root

    def pieces(self, word: str) -> list[Piece]:
        """Return a piece for each chain of joints that a word names, with what hangs on it."""
        body = self.body
        own = {number for number in range(len(body.joints)) if self._is_called(number, word)}
        pieces = []
        for first in sorted(own):
            if any(above in own for above in self._joints_above(first)):
                continue
            below = [n for n in range(len(body.joints)) if self._is_below(n, first)]
            held = self._held(first) if word in ("hand", "foot") else set()
            inside = [
                number
                for number in below
                if all(
                    self._belongs(each, word, own) and each not in held for each in self._joints_above(number, first)
                )
            ]
            weight = np.minimum(self._share(np.array(inside)), 1)
            if (weight > _INSIDE).mean() > _MOSTLY:  # all hangs on it, as on a back: itself is meant
                inside = [first]
                weight = np.minimum(self._share(np.array(inside)), 1)
            outside = [number for number in below if number not in inside]
            if (weight > _INSIDE).any() and (weight < _INSIDE).any():
                weight = body.smooth(weight, 2)
                carried = self._chains_of(outside, weight)
                pieces.append(Piece(body, weight, attachment(body, weight), body.joints[first].name, carried))
        return [piece for piece in pieces if len(piece.rows)]

    def _held(self, first: int) -> set[int]:
        """Return joints without a telling name that hold more than a hand or a foot itself, such as its axe."""
        joints, points = self.body.joints, self.body.points

        def extent(of: list[int]) -> float:
            own = points[self._share(np.array(of, np.int64)) > _INSIDE]
            return float(np.linalg.norm(np.ptp(own, axis=0))) if len(own) else 0.0

        below = [number for number in range(len(joints)) if self._is_below(number, first)]
        telling = [number for number in below if names.part_of(joints[number].name) is not None]
        itself = extent(telling)
        return {number for number in below if number not in telling and extent([number]) > itself > 0}

    def _chains_of(self, joints: list[int], weight: Floats) -> tuple[Floats, ...]:
        """Return how much each vertex (V,) follows each chain of some joints, beside a part with a weight (V,)."""
        chains = []
        for first in joints:
            if self.body.joints[first].parent not in joints:
                own = np.array([number for number in joints if self._is_below(number, first)])
                share = np.minimum(self._share(own), 1 - np.clip(weight, 0, 1))
                if (share > _INSIDE).any():
                    chains.append(share)
        return tuple(chains)

    def _is_called(self, number: int, word: str) -> bool:
        """Return whether a word names a joint: of a trunk or a limb, the chain decides in which it stands."""
        name = self.body.joints[number].name
        kind = self._kinds[number] if self._classes else ""
        if word == "finger" and kind == "arm" and _FINGERS & set(tokens(name)):
            return True
        if not names.means(name, word):
            return False
        if word == "shoulder":
            return "leg" not in {self._kinds[n] for n in range(len(self._kinds)) if self._is_below(n, number)}
        return kind == "body" if word in ("back", "hip", "belly", "body") else True

    def _belongs(self, number: int, word: str, own: set[int]) -> bool:
        """Return whether a joint at or below one that a word names is a part of it."""
        noun = names.part_of(self.body.joints[number].name)
        return number in own or word in _WITH_ALL_BELOW or noun is None or names.noun_part(word) is None

    def _joints_above(self, number: int, last: int | None = None) -> list[int]:
        """Return the joints above one; with `last`, itself and those below that one."""
        joints, at = [], number if last is not None else self.body.joints[number].parent
        while at >= 0 and at != last:
            joints.append(at)
            at = self.body.joints[at].parent
        return joints

    def _share(self, columns: Index) -> Floats:
        """Return how much each vertex (V,) follows some joints together."""
        if not len(columns):
            return np.zeros(len(self.body.points))
        return np.asarray(self.body.weights[:, columns].sum(1)).ravel()
