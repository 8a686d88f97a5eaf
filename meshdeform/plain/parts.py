"""Find the part that a word names: by joints, by names of nodes and materials, by components, else by the solid.

Head and tail are the two ends of the body in the mirror plane, cut at the narrowest section; the thin end is the tail.
Every finder returns weights with a band, and says how it found the part, or raises `PartNotFound`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from meshdeform.plain import names
from meshdeform.plain.body import UP, Body, Flags, Floats, Index, step
from meshdeform.plain.names import tokens
from meshdeform.plain.pieces import Limb, PartMissingError, Piece, attachment
from meshdeform.plain.stand import AROUND, Stand, find_stand
from meshdeform.plain.vocabulary import PART_NAMES, PART_OF
from meshdeform.plain.wording import one_off
from meshdeform.plain.words import part_and_sides

_CLASSES = {
    **dict.fromkeys(("face", "tongue"), "head"),
    **dict.fromkeys(("knee", "ankle"), "leg"),
    **dict.fromkeys(("middle", "ring", "clavicle"), "arm"),
}
"""The class of joints whose names are no part in a sentence."""
_CLASS_OF = {
    **dict.fromkeys(("leg", "thigh", "shin", "foot", "toe"), "leg"),
    **dict.fromkeys(("arm", "forearm", "hand", "finger", "wing"), "arm"),
    **dict.fromkeys(("head", "eye", "jaw", "nose", "hair", "horn", "trunk"), "head"),
    **dict.fromkeys(("ear",), "ear"),
    **dict.fromkeys(("neck",), "neck"),
    **dict.fromkeys(("tail",), "tail"),
}
"""The class of limbs that each part of a body belongs to."""
_OF_BODIES = frozenset({*_CLASS_OF, "belly", "body", "back", "shoulder", "hip"}) - {
    "hair",
    "eye",
    "nose",
    "horn",
    "trunk",
}
"""Parts of bodies that a skeleton has: where there is one, names of clothes say nothing about them."""
_WITH_ALL_BELOW = frozenset({"leg", "arm", "head", "tail", "ear", "wing", "hand", "foot"})
"""Parts to which all joints below theirs belong; what hangs on others is carried."""
_FINGERS = frozenset({"index", "middle", "ring", "pinky", "little", "thumb"})
_LEVEL = 0.9
_MOSTLY_LEVEL = 0.4
"""Upright share of normals from which a face is level, and share of a slab's surface that is: a trunk is round."""
_MOSTLY = 0.6
_UPPER_END, _OF_A_NECK, _LIKE_THE_NECK, _LONG_ENOUGH = 0.15, 0.35, 1.5, 0.22
"""Of the neck of a bottle: the share of the height that tells its section; this as a share of the largest, at most; how
many times as large it may be below, which no dome's or cone's stays; and its length as a share of the height, at least.
"""
_INSIDE, _HALF = 0.5, 0.501
_FEWEST = 6
"""Vertices of an arm, at least."""
_Found = TypeVar("_Found")
_HELPERS = frozenset({"ik", "pole", "target", "control", "ctrl"})


class _once(Generic[_Found]):  # noqa: N801 - like `cached_property`
    """A property that is looked for once: what is not there is missing each time for the same reason."""

    def __init__(self, find: Callable[[Any], _Found]) -> None:
        self._find, self.__doc__ = find, find.__doc__

    def __get__(self, parts: Any, _owner: type) -> _Found:
        if self._find not in parts.kept:
            try:
                parts.kept[self._find] = self._find(parts)
            except PartMissingError as missing:
                parts.kept[self._find] = missing
        value = parts.kept[self._find]
        if isinstance(value, PartMissingError):
            raise value.with_traceback(None)
        kept: _Found = value
        return kept


@dataclass(frozen=True)
class Legs:
    """Return the feet: what stands on the ground."""

    hip: float  # height at which they end
    foot: float  # height up to which feet keep their shape
    weight: Floats  # (V,) float64
    limb: Index  # (V,) int64: the number of the leg nearest to each vertex
    count: int
    found_by: str


@dataclass(frozen=True)
class Head:
    """A head on its neck."""

    weight: Floats  # (V,) float64
    pivot: Floats  # (3,) float64: where it sits
    up: Floats  # (3,) float64: unit vector of the neck, from the body
    neck: Floats  # (V,) float64: 0 in the body to 1 in the head
    neck_length: float
    found_by: str


@dataclass(frozen=True)
class Tail:
    """A tail: weights (V,), the distance (V,) of each vertex from its tip, and its length."""

    weight: Floats
    from_tip: Floats
    length: float
    found_by: str


@dataclass(frozen=True)
class _End:
    """An end of the body: distances (C,) of the cells from its tip, and the areas of sections `step` thick."""

    distances: Floats
    areas: Floats
    step: float
    far: int
    lead: float
    height: float


class Parts:
    """The parts of one body; each is looked for once."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.kept: dict[Callable[[Any], Any], Any] = {}
        self._named: dict[str, Limb] = {}

    def own_names(self) -> list[str]:
        """Return the names, as words without sides, of nodes and materials that are parts of their own."""
        own = (name for name, each in self.body.names.items() if self._is_part(each) and names.part_of(name) is None)
        named = (part_and_sides(list(tokens(name)))[1] for name in own)
        return list(dict.fromkeys(name for name in named if name))

    @cached_property
    def forward(self) -> int:
        """The sign of the front on its axis: as names say, away from the back of a seat, where the head is, or +Z."""
        if self.body.named_front is not None:
            return self.body.named_front[1]
        axis, middle = self.body.front, self.body.low + self.body.size / 2
        try:
            away = middle - self.body.points[self.back().weight > 0].mean(0)
        except PartMissingError:
            if self.rigged or self.built:
                return 1
            try:
                away = self.body.points[self.head.weight > _INSIDE].mean(0) - middle
            except PartMissingError:
                return 1
        return -1 if away[axis] < -0.05 * self.body.size[axis] else 1

    def of_class(self, name: str) -> Floats | None:
        """Return how much each vertex (V,) follows the joints of a class, such as `leg`; None without such joints."""
        return self._classes.get(name)

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
                kind = _CLASSES[squeezed[0]]
            kinds.append("body" if _HELPERS & set(words) and not kind else kind)
        for number, joint in enumerate(joints):  # a bone that has no telling name belongs to the limb above it
            if not kinds[number]:
                at = joint.parent
                while at >= 0 and not kinds[at]:
                    at = joints[at].parent
                kinds[number] = kinds[at] if at >= 0 and kinds[at] not in ("neck",) else "body"
        self._kinds = kinds
        columns = np.array(kinds)
        return {kind: _share(self.body, np.flatnonzero(columns == kind)) for kind in dict.fromkeys(kinds)}

    @property
    def rigged(self) -> bool:
        """Whether joints tell limbs apart."""
        return len(self._classes) > 1

    # ---------------------------------------------------------------- legs

    @_once
    def legs(self) -> Legs:
        """The legs.

        Raises PartMissingError: nothing stands between the ground and the body.
        """
        body = self.body
        if self.wheels.any():
            raise PartMissingError("This stands on wheels: it has no legs.")
        rigged = self._standing_joints()
        if self.rigged and rigged is None:
            raise PartMissingError("The skeleton has no legs that stand on the ground.")
        try:
            stand: Stand | None = self._stand
        except PartMissingError:
            if rigged is None:
                raise
            stand = None
        if rigged is None:
            assert stand is not None
            weight = body.solid.at((stand.labels > 0).astype(float), body.points, nearest=True)
            hip, found_by = stand.hip, "geometry"
            foot = max(body.ground + 0.08 * (hip - body.ground), stand.base)
        else:
            weight, found_by = rigged, "joints"
            between = (weight > 0.25) & (weight < 0.75)
            heights = body.points[between, UP] if between.any() else body.points[weight > 0.5, UP]
            joint_hip = float(np.median(heights) if between.any() else np.percentile(heights, 95))
            hip = (
                joint_hip
                if stand is None
                else min(max(stand.hip, joint_hip), body.ground + 1.15 * (joint_hip - body.ground))
            )
            foot = body.ground + 0.22 * (hip - body.ground)
        return Legs(hip, foot, weight, self._nearest_limb(stand), stand.count if stand else 2, found_by)

    def leg_pieces(self) -> Limb:
        """Return the legs one by one.

        Raises PartMissingError: there are none.
        """
        body, legs = self.body, self.legs
        chains = [] if legs.found_by == "geometry" else self._chains("leg")
        pieces = []
        for number in np.unique(legs.limb[legs.weight > _INSIDE]):
            weight = np.where(legs.limb == number, legs.weight, 0)
            own = weight > _INSIDE
            if not own.any():
                continue
            top = body.points[own & (body.points[:, UP] > legs.hip - 0.2 * (legs.hip - body.ground))]
            pivot = (top if len(top) else body.points[own]).mean(0)
            pivot[UP] = legs.hip
            held = [float(np.minimum(share, weight).sum()) for _, share in chains]
            name = body.joints[chains[int(np.argmax(held))][0]].name if held else ""
            pieces.append(Piece(body, weight, pivot, name))
        return Limb(body, pieces, legs.found_by)

    def _chains(self, kind: str) -> list[tuple[int, Floats]]:
        """Return the first joint of each chain of a class, and how much each vertex (V,) follows the chain."""
        body = self.body
        found = []
        for number, joint in enumerate(body.joints):
            if self._kinds[number] == kind and (joint.parent < 0 or self._kinds[joint.parent] != kind):
                below = [n for n in range(len(body.joints)) if self._kinds[n] == kind and self._under(n, number)]
                found.append((number, _share(body, np.array(below))))
        return found

    def _standing_joints(self) -> Floats | None:
        """Return how much each vertex follows chains of leg joints that reach the ground; None if there are none."""
        body = self.body
        total = self.of_class("leg")
        if total is None or total.max() <= 0.5:
            return None
        joints = np.zeros(len(body.points))
        for _, share in self._chains("leg"):
            own = body.points[share > 0.5, UP]
            if len(own) and own.min() < body.ground + 0.15 * body.size[UP] and np.ptp(own) > 0.05 * body.size[UP]:
                joints += share
        # A foot may follow a control that hangs on the root: it belongs to legs that end above the ground.
        return body.smooth(np.minimum(joints, 1), 3) if joints.max() > 0.5 else None

    def _under(self, number: int, root: int) -> bool:
        while number >= 0 and number != root:
            number = self.body.joints[number].parent
        return number == root

    def _nearest_limb(self, stand: Stand | None) -> Index:
        body = self.body
        if stand is None or stand.count < 1:
            return np.asarray((body.points[:, body.lateral] > body.middle).astype(np.int64))
        within = np.flatnonzero(stand.labels > 0)
        near = cKDTree(body.solid.centres[within]).query(body.points)[1]
        return np.asarray(stand.labels[within][near], np.int64)

    @_once
    def _stand(self) -> Stand:
        return find_stand(self.body)

    # ---------------------------------------------------------------- head, neck, tail

    @_once
    def head(self) -> Head:
        """The head.

        Raises PartMissingError: there is nothing like a neck.
        """
        own = self.of_class("head")
        if own is not None and own.max() > 0.5:
            return self._head_of_joints(own)
        if self.rigged:
            raise PartMissingError("The skeleton has no head.")
        if self.built:
            raise PartMissingError("No head was found: this is a thing on legs or wheels.")
        head = self._head_of_ends() or self._head_of_levels()
        if head is None:
            raise PartMissingError("No head was found: there is nothing like a neck.")
        return head

    def _head_of_joints(self, own: Floats) -> Head:
        body = self.body
        none = np.zeros(len(own))
        ears, neck = self.of_class("ear"), self.of_class("neck")
        share = np.minimum(1, own + (none if ears is None else ears))
        throat = none if neck is None else neck
        weight = body.smooth(np.minimum(1, share + 0.35 * throat), 2)
        middle = body.points[share > 0.5].mean(0)
        between = throat > 0.3 if (throat > 0.3).any() else (share > 0.2) & (share < 0.8)
        if between.any():
            pivot = body.points[between].mean(0)
        else:
            pivot = middle - np.array([0, 0.5 * np.ptp(body.points[share > 0.5, UP]), 0])
        up = _unit(middle - pivot, body.lateral)
        along = body.points @ up
        if (throat > 0.3).any():
            low, length = float(along[throat > 0.3].min()), float(np.ptp(along[throat > 0.3]))
            profile = np.minimum(1, share + throat * np.clip((along - low) / max(length, 1e-9), 0, 1))
        else:
            length = 0.3 * float(np.ptp(along[share > 0.5]))
            profile = np.minimum(1, share + 0.5 * throat)
        return Head(weight, pivot, up, body.smooth(profile, 3), length, "joints")

    def _head_of_ends(self) -> Head | None:
        """Return the head of something that stands along the ground, by its sections from the tip."""
        body, solid = self.body, self.body.solid
        end = self._ends[0]
        cut = _cut_of_head(end)
        if cut is None:
            return None
        cells = end.distances
        if (cells < cut).mean() > 0.45:  # most of it is no head
            return None
        distance, band = solid.at(cells, body.points), 0.6 * cut
        pivot = solid.centres[np.abs(cells - cut) < 1.5 * solid.side].mean(0)
        up = _unit(solid.centres[cells < cut].mean(0) - pivot, body.lateral)
        weight = 1 - step((distance - (cut - 0.5 * band)) / band)
        profile = 1 - step((distance - (cut - 0.3 * band)) / (1.2 * band))
        return Head(weight, pivot, up, profile, band, "geometry")

    def _head_of_levels(self) -> Head | None:
        """Return the head of something upright: what is above its narrowest level."""
        body, solid = self.body, self.body.solid
        top = float(solid.centres[:, UP].max())
        depth = top - solid.centres[:, UP]
        areas = ndimage.gaussian_filter1d(np.bincount((depth / solid.side + 0.5).astype(int)).astype(float), 1.2)
        before, after = np.maximum.accumulate(areas), np.maximum.accumulate(areas[::-1])[::-1]
        levels = range(int(0.12 * len(areas)), int(0.65 * len(areas)))
        dips = [
            (min(before[k], after[k]) / max(areas[k], 1), k)
            for k in levels
            if areas[k] <= areas[k - 1] and areas[k] <= areas[k + 1]
        ]
        if not dips or max(dips)[0] < 1.25:
            return None
        cut = max(dips)[1] * solid.side
        weight = 1 - step((top - body.points[:, UP] - 0.8 * cut) / (0.4 * cut))
        layers = solid.heights(np.arange(solid.filled.shape[UP]))
        labels, _ = ndimage.label(solid.filled & (layers > top - 1.15 * cut)[None, :, None], AROUND)
        highest = labels[tuple(solid.cells[np.argmax(solid.centres[:, UP])])]
        weight = weight * solid.at((labels[solid.filled] == highest).astype(float), body.points, nearest=True)
        pivot = solid.centres[np.abs(depth - cut) < 1.5 * solid.side].mean(0)
        return Head(weight, pivot, np.array([0.0, 1.0, 0.0]), weight, 0.3 * cut, "geometry")

    @cached_property
    def built(self) -> bool:
        """Whether it stands on wheels, or is a slab on legs."""
        try:
            return bool(self.wheels.any()) or self.slab is not None
        except PartMissingError:
            return False

    @_once
    def tail(self) -> Tail:
        """The tail.

        Raises PartMissingError: the rear end is not thin.
        """
        body, solid = self.body, self.body.solid
        own = self.of_class("tail")
        if own is not None and own.max() > 0.5:
            weight = body.smooth(own, 2)
            rest = body.points[weight <= 0.3].mean(0)
            mine = np.flatnonzero(weight > 0.6)
            tip = body.points[mine][np.argmax(np.linalg.norm(body.points[mine] - rest, axis=1))]
            distance = solid.at(solid.distances(solid.nearest(tip)), body.points)
            return Tail(weight, distance, float(np.percentile(distance[mine], 98)), "joints")
        if self.rigged:
            raise PartMissingError("The skeleton has no tail.")
        if self.built:
            raise PartMissingError("No tail was found: this is a thing on legs or wheels.")
        end = self._ends[1]
        wide = int(np.argmax(end.areas > 0.3 * end.areas[: end.far].max()))
        if wide < 0.18 * end.far:
            raise PartMissingError("No tail was found: the rear end is not thin.")
        cut = wide * end.step
        distance = solid.at(end.distances, body.points)
        return Tail(1 - step((distance - 0.85 * cut) / (0.3 * cut)), distance, cut, "geometry")

    @cached_property
    def _ends(self) -> tuple[_End, _End]:
        """The two ends along the front axis that are no leg: head, tail."""
        body, solid = self.body, self.body.solid
        try:
            labels, trunk = self._stand.labels, self._stand.trunk
        except PartMissingError:
            labels, trunk = np.zeros(len(solid.cells), int), np.zeros(len(solid.cells), bool)
        free = (labels == 0) & ~trunk
        if not free.any():
            free = np.ones(len(labels), bool)
        centre = solid.centres[free].mean(0)
        from_centre = np.where(free, solid.distances(solid.nearest(centre)), -1)
        forward = solid.centres[:, body.front] - centre[body.front]
        sideways = np.abs(solid.centres[:, body.lateral] - body.middle)
        near = sideways < max(0.1 * body.size[body.lateral], 1.5 * solid.side)
        ends = []
        for sign in (1, -1):
            tip = int(np.argmax(np.where(free & near & (sign * forward > 0), from_centre, -1)))
            distances, thick = solid.distances(tip), 1.5 * solid.side
            bins = (distances / thick).astype(int)
            areas = np.bincount(bins[free], minlength=bins.max() + 1).astype(float)
            areas = ndimage.gaussian_filter1d(areas, 1.2)
            far = max(5, int(from_centre[tip] / thick))
            lead = areas[: max(3, int(0.25 * far))].mean() / max(areas[:far].max(), 1)
            height = float(solid.centres[free & (distances < 0.4 * max(from_centre[tip], solid.side)), UP].mean())
            ends.append(_End(distances, areas, thick, far, float(lead), height))
        higher = 1.2 * (ends[0].height - ends[1].height) / max(float(body.size[UP]), 1e-12)
        return (ends[0], ends[1]) if ends[0].lead + higher >= ends[1].lead else (ends[1], ends[0])

    # ---------------------------------------------------------------- others

    @_once
    def arms(self) -> Limb:
        """The arms of a skeleton.

        Raises PartMissingError: there are none.
        """
        body, pieces = self.body, []
        for number, share in self._chains("arm") if self.of_class("arm") is not None else []:
            weight = body.smooth(share, 2)
            if (weight > _INSIDE).sum() >= _FEWEST:
                pieces.append(Piece(body, weight, attachment(body, weight), body.joints[number].name))
        if not pieces:
            raise PartMissingError("No arms were found: arms are known by the joints of a skeleton.")
        return Limb(body, pieces, "joints")

    @cached_property
    def wheels(self) -> Flags:
        """The vertices (V,) of wheels: by name, else components that are round about the lateral axis and stand low."""
        body = self.body
        wheels = np.zeros(len(body.points), bool)
        for name, flags in body.names.items():
            if names.part_of(name) == "wheel" and not flags.all():
                wheels |= flags
        if wheels.any() or self.rigged or body.components.max() >= 400:
            return wheels
        order = np.argsort(body.components, kind="stable")
        for own in np.split(order, np.cumsum(np.bincount(body.components))[:-1]):
            points = body.points[own]
            size, middle = np.ptp(points, axis=0), (points.max(0) + points.min(0)) / 2
            low = points[:, UP].min() < body.ground + 0.12 * body.size[UP] and size[UP] < 0.5 * body.size[UP]
            square = abs(size[UP] - size[body.front]) < 0.04 * size[UP] and size[body.lateral] < 0.8 * size[UP]
            if len(own) >= 16 and low and square:
                radius = np.hypot(points[:, UP] - middle[UP], points[:, body.front] - middle[body.front])
                rim = size[UP] / 2
                if (radius > 0.93 * rim).mean() > 0.25 and radius.max() < 1.06 * rim:
                    wheels[own] = True
        return wheels

    def wheel_pieces(self) -> Limb:
        """Return the wheels one by one, each about its own middle.

        Raises PartMissingError: there are none.
        """
        body, wheels = self.body, self.wheels
        if not wheels.any():
            raise PartMissingError("No wheels were found.")
        named = [(name, flags) for name, flags in body.names.items() if names.part_of(name) == "wheel"]
        sources = [(name, flags & wheels) for name, flags in named if (flags & wheels).any()] or [("", wheels)]
        pieces, taken = [], np.zeros(len(wheels), bool)
        for name, flags in sorted(sources, key=lambda source: int(source[1].sum())):
            for own in body.groups(flags & ~taken):  # a node of a wheel, and its material
                weight = np.zeros(len(wheels))
                weight[own] = 1.0
                middle = (body.points[own].max(0) + body.points[own].min(0)) / 2
                pieces.append(Piece(body, weight, middle, name))
                taken[own] = True
        return Limb(body, pieces, "names" if named else "components")

    @_once
    def slab(self) -> tuple[float, float]:
        """The heights between which the widest slab above legs lies: a seat, or the top of a table.

        Raises PartMissingError: it has no legs, or nothing like a slab.
        """
        body, solid = self.body, self.body.solid
        if self.rigged:
            raise PartMissingError("A body with a skeleton has no seat.")
        hip = self.legs.hip
        areas = solid.filled.sum((0, 2)).astype(float)
        heights = solid.heights(np.arange(len(areas)))
        above = np.flatnonzero(heights > hip - 2 * solid.side)
        widest = above[np.argmax(areas[above])]
        low = high = int(widest)
        while areas[low - 1] > 0.6 * areas[widest]:
            low -= 1
        while high + 1 < len(areas) and areas[high + 1] > 0.6 * areas[widest]:
            high += 1
        thick = (high - low + 1) * solid.side
        bottom, top = float(heights[low] - solid.side / 2), float(heights[high] + solid.side / 2)
        narrow = areas[widest] < 0.3 * body.size[0] * body.size[2] / solid.side**2
        if thick > 0.3 * body.size[UP] or narrow or not self._is_level(bottom, top):
            raise PartMissingError("No seat or top was found: there is no slab on legs.")
        return bottom, top

    def _is_level(self, low: float, high: float) -> bool:
        """Return whether most of the surface between two heights is level."""
        body = self.body
        middles = body.corners[:, :, UP].mean(1)
        lengths = np.linalg.norm(body.crosses, axis=1)
        within = (middles > low - body.solid.side) & (middles < high + body.solid.side)
        level = np.abs(body.crosses[:, UP]) > _LEVEL * lengths
        return bool(lengths[within & level].sum() > _MOSTLY_LEVEL * lengths[within].sum())

    def back(self) -> Limb:
        """Return the part above a seat.

        Raises PartMissingError: there is no seat, or nothing above it.
        """
        body = self.body
        _, seat = self.slab
        if body.points[:, UP].max() - seat < 0.1 * body.size[UP]:
            raise PartMissingError("No back was found: nothing stands above the seat.")
        weight = (body.points[:, UP] > seat - 0.5 * body.solid.side).astype(float)
        above = body.points[weight > 0]
        pivot = np.array([above[:, 0].mean(), seat, above[:, 2].mean()])
        return Limb(body, [Piece(body, weight, pivot)], "geometry")

    @_once
    def bottle_neck(self) -> tuple[float, float]:
        """The heights between which the neck of a bottle is: narrow, and above where it is widest.

        Raises PartMissingError: it has none.
        """
        body, solid = self.body, self.body.solid
        areas = ndimage.gaussian_filter1d(solid.filled.sum((0, 2)).astype(float), 1.0)
        layers = np.flatnonzero(areas > 0.05 * areas.max())
        widest, top = int(np.argmax(areas)), int(layers.max())
        usual = float(areas[top - int(_UPPER_END * len(layers)) : top + 1].max())
        low = top
        while low > widest and areas[low] < _LIKE_THE_NECK * usual:
            low -= 1
        short = (top - low) * solid.side < _LONG_ENOUGH * body.size[UP]
        if self.built or self.stands_on_legs or short or usual > _OF_A_NECK * areas[widest]:
            raise PartMissingError("No neck was found: nothing narrow is above a wide part.")
        return float(solid.heights(np.array([low + 1]))[0]), float(solid.heights(np.array([top]))[0])

    @property
    def is_bottle(self) -> bool:
        """Whether it has a neck such as bottles have."""
        try:
            return self.bottle_neck is not None
        except PartMissingError:
            return False

    @property
    def stands_on_legs(self) -> bool:
        """Whether it has several legs."""
        try:
            return self.legs.count > 1
        except PartMissingError:
            return False

    def is_named(self, word: str) -> bool:
        """Return whether joints, nodes or materials have the name of a part."""
        try:
            self.named(word)
        except PartMissingError:
            return False
        return True

    def named(self, word: str) -> Limb:
        """Return the part that joints, nodes or materials with this name make.

        Raises PartMissingError: none has it, or all of the asset does.
        """
        if word not in self._named:
            self._named[word] = self._find_named(word)
        return self._named[word]

    def _find_named(self, word: str) -> Limb:
        body = self.body
        pieces = self._pieces_of_joints(word)
        if pieces:
            return Limb(body, pieces, "joints")
        pieces = [] if self.rigged and word in _OF_BODIES else self._pieces_of_names(word)
        if not pieces:
            raise PartMissingError(f"No part called {word!r} was found.")
        return Limb(body, pieces, "names")

    def spelled(self, word: str) -> str:
        """Return a part of a sentence as the file spells it: of a name that it lacks, the only one a letter off."""
        if word in PART_NAMES or self.is_named(word):
            return word
        known = [*self.own_names(), *(part for part in PART_OF if self.is_named(PART_OF[part]))]
        near = {PART_OF.get(each, each) for each in known if one_off(word, each)}
        return near.pop() if len(near) == 1 else word

    def _pieces_of_joints(self, word: str) -> list[Piece]:
        """Return a piece for each chain of joints that a word names, with what hangs on it."""
        body = self.body
        own = {number for number in range(len(body.joints)) if self._is_called(number, word)}
        pieces = []
        for first in sorted(own):
            if any(above in own for above in self._above(first)):
                continue
            below = [n for n in range(len(body.joints)) if self._under(n, first)]
            held = self._held(first) if word in ("hand", "foot") else set()
            inside = [
                number
                for number in below
                if all(self._belongs(each, word, own) and each not in held for each in self._above(number, first))
            ]
            weight = np.minimum(_share(body, np.array(inside)), 1)
            if (weight > _INSIDE).mean() > _MOSTLY:  # all hangs on it, as on a back: itself is meant
                inside = [first]
                weight = np.minimum(_share(body, np.array(inside)), 1)
            outside = [number for number in below if number not in inside]
            if (weight > _INSIDE).any() and (weight < _INSIDE).any():
                weight = body.smooth(weight, 2)
                pieces.append(
                    Piece(
                        body,
                        weight,
                        attachment(body, weight),
                        body.joints[first].name,
                        self._chains_of(outside, weight),
                    )
                )
        return [piece for piece in pieces if len(piece.rows)]

    def _held(self, first: int) -> set[int]:
        """Return joints without a telling name that hold more than a hand or a foot itself, such as its axe."""
        joints, points = self.body.joints, self.body.points

        def extent(of: list[int]) -> float:
            own = points[_share(self.body, np.array(of, np.int64)) > _INSIDE]
            return float(np.linalg.norm(np.ptp(own, axis=0))) if len(own) else 0.0

        below = [number for number in range(len(joints)) if self._under(number, first)]
        telling = [number for number in below if names.part_of(joints[number].name) is not None]
        itself = extent(telling)
        return {number for number in below if number not in telling and extent([number]) > itself > 0}

    def _chains_of(self, joints: list[int], weight: Floats) -> tuple[Floats, ...]:
        """Return how much each vertex (V,) follows each chain of some joints, beside a part with a weight (V,)."""
        chains = []
        for first in joints:
            if self.body.joints[first].parent not in joints:
                own = np.array([number for number in joints if self._under(number, first)])
                share = np.minimum(_share(self.body, own), 1 - np.clip(weight, 0, 1))
                if (share > _INSIDE).any():
                    chains.append(share)
        return tuple(chains)

    def _is_called(self, number: int, word: str) -> bool:
        """Return whether a word names a joint: of a trunk or a limb, the chain decides in which it stands."""
        name, kind = self.body.joints[number].name, self._kind_of(number)
        if word == "finger" and kind == "arm" and _FINGERS & set(tokens(name)):
            return True
        if not names.means(name, word):
            return False
        if word == "shoulder":
            return "leg" not in {self._kinds[n] for n in range(len(self._kinds)) if self._under(n, number)}
        return kind == "body" if word in ("back", "hip", "belly", "body") else True

    def _kind_of(self, number: int) -> str:
        return self._kinds[number] if self._classes else ""

    def _belongs(self, number: int, word: str, own: set[int]) -> bool:
        """Return whether a joint at or below one that a word names is a part of it."""
        noun = names.part_of(self.body.joints[number].name)
        return number in own or word in _WITH_ALL_BELOW or noun is None or names.noun_part(word) is None

    def _above(self, number: int, last: int | None = None) -> list[int]:
        """Return the joints above one; with `last`, itself and those below that one."""
        found, at = [], number if last is not None else self.body.joints[number].parent
        while at >= 0 and at != last:
            found.append(at)
            at = self.body.joints[at].parent
        return found

    def _pieces_of_names(self, word: str) -> list[Piece]:
        """Return a piece for each group of vertices of the nodes and materials that a word names."""
        body = self.body
        taken = np.zeros(len(body.points), bool)
        pieces = []
        chosen = [(name, each) for name, each in body.names.items() if names.means(name, word) and self._is_part(each)]
        for name, each in sorted(chosen, key=lambda pair: int(pair[1].sum())):
            flags = each & ~taken
            taken |= each
            smoothed = body.smooth(flags.astype(float), 2)
            # Components that belong to it in whole are not blended with what they merely touch.
            whole = np.bincount(body.components, ~flags)[body.components] == 0
            weight = np.where(whole & flags, 1.0, np.where(flags, np.maximum(smoothed, _HALF), smoothed * ~whole))
            found = Limb.of_weight(body, weight, "names", attachment(body, flags.astype(float)))
            pieces += [replace(piece, name=name) for piece in found.pieces if len(piece.rows)]
        return pieces

    def _is_part(self, flags: Flags) -> bool:
        return bool(flags.any() and not flags.all())


def _cut_of_head(end: _End) -> float | None:
    """Return how far from its tip a head ends: at the deepest dip of its sections; None if there is none."""
    areas, far = end.areas, end.far
    first, last = max(3, int(0.2 * far)), max(6, far + 2)
    before = np.maximum.accumulate(areas)
    after = np.maximum.accumulate(areas[: int(1.25 * far) + 3][::-1])[::-1]
    best: tuple[float, int] | None = None
    for k in range(first, min(last, len(after) - 1)):
        dip = min(before[k], after[k]) / max(areas[k], 1e-9)
        lowest = (k == first or areas[k] <= areas[k - 1]) and areas[k] <= areas[k + 1]
        if lowest and dip > 1.12 and (best is None or dip > 1.25 * best[0]):
            best = (dip, k)
    return None if best is None else (best[1] + 0.5) * end.step


def _share(body: Body, columns: Index) -> Floats:
    """Return how much each vertex follows some joints together."""
    if not len(columns):
        return np.zeros(len(body.points))
    return np.asarray(body.weights[:, columns].sum(1)).ravel()


def _unit(vector: Floats, lateral: int) -> Floats:
    """Return the direction of a vector in the mirror plane."""
    flat = vector.copy()
    flat[lateral] = 0
    length = np.linalg.norm(flat)
    return flat / length if length > 0 else np.array([0.0, 1.0, 0.0])
