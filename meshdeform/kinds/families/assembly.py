"""Make a shape out of parts of members: choose them, deform them onto the points, and make neighbours meet."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.assets.assemble import Piece
from meshdeform.assets.family_file import FamilyFile
from meshdeform.kinds.families.embedded import Embedding, Pull, axis_fit
from meshdeform.kinds.families.members import Contact, MemberPart, MemberShape, PlacedSurface, depth_beyond, turned
from meshdeform.kinds.families.sampling import Drawn

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_NODE_WEIGHT, _CONTACT_WEIGHT = 0.5, 50.0
_FAR, _LEAST_FAR = 2.5, 0.04
"""Points farther from their places than so many times the median, and than so many diagonals, are no match."""
_FEWEST = 4
_STILL = 1e-4
"""Gaps below this share of the diagonal are none."""
_REACH = 0.15
"""A neighbour farther than this share of the diagonal is another one than in the member: nothing is pulled there."""
_MEETINGS = 2
_FIRM = 1e9
"""Weight of a vertex of a part that may not move, beside one of a part that may."""
_KEPT = 8


@dataclass
class PlacedPart:
    """A part of a member on its way to its place; all in the frame."""

    # The part, and the member that it is from
    number: int
    member: int
    shape: MemberShape
    # (3,) float64: the rough fit, before the embedded deformation
    scale: _Floats
    shift: _Floats
    embedding: Embedding | None  # none where nothing may move
    pulls: list[Pull] = field(default_factory=list)
    distance: float = 0.0
    """Root mean square distance of the part's points from where they should be, after the rough fit, in diagonals."""
    # In diagonals, beyond what the member itself has: the widest gap to a neighbour, as the mean over the place where
    # they touch there, and how far the part goes into one
    gap: float = 0.0
    penetration: float = 0.0

    @property
    def part(self) -> MemberPart:
        """The part of the member."""
        return self.shape.part(self.number)

    def roughly(self, points: _Floats) -> _Floats:
        """Return points (P, 3) of the member after the rough fit."""
        return points + ((self.scale - 1) * points + self.shift)

    def moved(self, points: _Floats, patches: _Index) -> _Floats:
        """Return the displacement (P, 3) of points of the member."""
        rough = (self.scale - 1) * points + self.shift
        return rough if self.embedding is None else rough + self.embedding.displacement(points + rough, patches)

    def surface(self) -> PlacedSurface:
        """Return the part in its place."""
        part = self.part
        return PlacedSurface(part.verts + self.moved(part.verts, part.patches), part.faces)


@dataclass(frozen=True)
class Assembly:
    """A shape made of parts."""

    parts: list[PlacedPart]
    pieces: list[Piece]  # for `assets.assemble`
    loose: list[int]  # parts that touch no other part, because no member says where they would

    @property
    def fault(self) -> float:
        """The widest gap or the deepest penetration, in diagonals."""
        return max((max(each.gap, each.penetration) for each in self.parts), default=0.0)


class Assembler:
    """Makes shapes of a family out of parts of its members.

    Parameters
    ----------
    load : callable
        Returns the asset of a member.
    defects : (T, L) float64
        `boundary_defects` of the members.
    most_defect : float
        Parts with a greater one are not used where others are there.
    """

    def __init__(self, family: FamilyFile, load: Callable[[int], Asset], defects: _Floats, most_defect: float) -> None:
        self.family, self._load = family, load
        finite = np.where(np.isfinite(defects), defects, np.inf)
        best = finite.min(0, keepdims=True)
        self.offered = np.isfinite(finite) & (finite <= np.maximum(most_defect, best))
        self._shapes: dict[int, MemberShape] = {}

    def shape(self, member: int) -> MemberShape:
        """Return a member, and keep the last few."""
        if member not in self._shapes:
            while len(self._shapes) >= _KEPT:
                del self._shapes[next(iter(self._shapes))]
            self._shapes[member] = MemberShape(self.family, member, self._load(member))
        return self._shapes[member]

    def chosen(self, draw: Drawn) -> dict[int, int]:
        """Return the first member for each part that may give it and has points of it that the shape has.

        A part that is drawn of one member alone comes from that one, whatever its boundary.
        """
        choice: dict[int, int] = {}
        there = self.family.exists & draw.exists
        for part, members in draw.sources.items():
            own = np.asarray(there[:, self.family.labels == part].any(axis=1))
            for member in members:
                if (own[member] and self.offered[member, part]) or (len(members) == 1 and there[member].any()):
                    choice[part] = member
                    break
        return choice

    def assemble(
        self,
        points: _Floats,
        exists: NDArray[np.bool_],
        choice: Mapping[int, int],
        *,
        kept: Collection[int] = (),
        diagonal: float,
        centre: _Floats,
    ) -> Assembly:
        """Deform the chosen parts onto the points, and move each to its neighbours that are in place already.

        Parameters
        ----------
        points : (K, 3) float64
            In the frame.
        exists : (K,) bool
        kept : collection of int
            Parts that stay exactly as they are in their member.
        diagonal : float
            Of the frame in units of the result.
        centre : (3,) float64
        """
        placed = [self._placed(points, exists, part, member, part in kept) for part, member in choice.items()]
        waiting = self._in_order(placed)
        done: list[PlacedPart] = []
        surfaces: dict[int, PlacedSurface] = {}
        loose: list[int] = []
        while waiting:
            ready = next((each for each in waiting if self._meetings(each, done)), None)
            each = ready or waiting[0]
            waiting.remove(each)
            if ready is None and done and each.embedding is not None:
                loose.append(each.number)
            self._meet(each, done, surfaces)
            surfaces[each.number] = each.surface()
            done.append(each)
        for each in placed:
            each.penetration = max(
                (_beyond(each, other, surfaces) for other in placed if other is not each), default=0.0
            )
        ways = sewn(placed)
        return Assembly(placed, [self._piece(each, ways[each.number], diagonal, centre) for each in placed], loose)

    def _placed(self, points: _Floats, exists: NDArray[np.bool_], part: int, member: int, kept: bool) -> PlacedPart:
        family, shape = self.family, self.shape(member)
        common = exists & family.exists[member] & (family.labels == part)
        still = PlacedPart(part, member, shape, np.ones(3), np.zeros(3), None)
        if kept or int(common.sum()) < 1:
            return still
        source, target = family.points[member, common], points[common]
        near, scale, shift, distance = _rough_fit(source, target)
        source, target = source[near], target[near]
        nodes = source + ((scale - 1) * source + shift)
        patches = shape.part(part).patch_of(source)
        for last in (False, True):
            pull, embedding = Pull(nodes, target, patches, _NODE_WEIGHT), Embedding(nodes, patches)
            embedding.solve([pull])
            apart = np.linalg.norm(nodes + embedding.displacement(nodes, patches) - target, axis=1)
            match = apart <= max(_FAR * float(np.median(apart)), _LEAST_FAR / 2)
            if last or match.all():
                break
            nodes, target, patches = nodes[match], target[match], patches[match]
        return PlacedPart(part, member, shape, scale, shift, embedding, [pull], distance)

    def _in_order(self, placed: list[PlacedPart]) -> list[PlacedPart]:
        """Return what may not move first; else what touches most others in most of the members; then the largest."""
        by_area = sorted(placed, key=lambda each: -each.part.area)
        if any(each.embedding is None for each in placed):
            return sorted(by_area, key=lambda each: each.embedding is not None)
        shapes = {each.member: each.shape for each in placed}.values()
        touches = [
            sum(bool(s.contacts(o.number, e.number)) for s in shapes for o in placed if o is not e) for e in by_area
        ]
        first = by_area.pop(touches.index(max(touches)))
        return [first, *by_area]

    def _meetings(self, each: PlacedPart, done: list[PlacedPart]) -> list[tuple[PlacedPart, bool, list[Contact]]]:
        """Return the placed neighbours of a part, whose side the contacts are on (True: its own), and the contacts."""
        # A part that may not move says itself where it is touched: those of others meet their own neighbours elsewhere.
        meetings = []
        for other in done:
            own, theirs = (a.shape.contacts(a.number, b.number) for a, b in ((each, other), (other, each)))
            if own and not (theirs and other.embedding is None):
                meetings.append((other, True, own))
            elif theirs:
                meetings.append((other, False, theirs))
        return meetings

    def _meet(self, each: PlacedPart, done: list[PlacedPart], surfaces: dict[int, PlacedSurface]) -> None:
        meetings = self._meetings(each, done)
        if not meetings:
            return
        for round_ in range(_MEETINGS + 1):
            pulls, gap = [], 0.0
            own = each.surface()
            for other, mine, contacts in meetings:
                whole = each.member == other.member and each.shape.of_one_piece(each.number, other.number)
                for contact in contacts:
                    pull, apart = (_towards if mine else _from_other)(each, own, other, surfaces[other.number], contact)
                    gap = gap if whole else max(gap, apart)
                    if pull is not None:
                        pulls.append(pull)
            each.gap = gap
            if each.embedding is None or not pulls or round_ == _MEETINGS:
                return
            each.embedding.solve([*each.pulls, *pulls])

    def _piece(self, each: PlacedPart, moved: _Floats, diagonal: float, centre: _Floats) -> Piece:
        shape, part, surface = each.shape, each.part, each.shape.asset.surface
        positions, normals, tangents = surface.positions.copy(), surface.normals.copy(), surface.tangents.copy()
        if shape.turn == 0 and diagonal == shape.diagonal and np.array_equal(centre, shape.centre):
            positions[part.rows] += moved * diagonal
        else:
            positions[part.rows] = (part.verts + moved) * diagonal + centre
        if moved.any() or shape.turn != 0:
            maps = np.tile(np.diag(each.scale), (len(part.rows), 1, 1))
            if each.embedding is not None:
                maps = each.embedding.linear(each.roughly(part.verts), part.patches) @ maps
            normals[part.rows] = _directions(_cofactors(maps), turned(normals[part.rows], shape.turn))
            tangents[part.rows, :3] = _directions(maps, turned(tangents[part.rows, :3], shape.turn))
        extras = {"part": self.family.parts[each.number], "member": self.family.names[each.member]}
        return Piece(shape.asset, part.triangles, positions, normals, tangents, extras["part"], {"meshdeform": extras})


def _rough_fit(source: _Floats, target: _Floats) -> tuple[NDArray[np.bool_], _Floats, _Floats, float]:
    """Return which points match, the scale and the shift of the others' fit, and its root mean square distance."""
    near = np.ones(len(source), bool)
    for _ in range(3):
        scale, shift = axis_fit(source[near], target[near])
        if int(near.sum()) < _FEWEST:
            scale, shift = np.ones(3), (target[near] - source[near]).mean(0)
        apart = np.linalg.norm(source + ((scale - 1) * source + shift) - target, axis=1)
        kept = apart <= max(_FAR * float(np.median(apart)), _LEAST_FAR)
        if (kept == near).all():
            break
        near = kept
    return near, scale, shift, float(np.sqrt((apart**2).mean()))


def _towards(
    each: PlacedPart, _own: PlacedSurface, _other: PlacedPart, target: PlacedSurface, contact: Contact
) -> tuple[Pull | None, float]:
    """Pull the points of a contact of a part onto its neighbour, with the offset that they have in the member."""
    here = contact.points + each.moved(contact.points, contact.patches)
    place = target.nearest(here, contact.normals)[2]
    return _pull(each, contact.points, contact.patches, place + contact.offsets - here, here - place, contact)


def _from_other(
    each: PlacedPart, own: PlacedSurface, other: PlacedPart, _target: PlacedSurface, contact: Contact
) -> tuple[Pull | None, float]:
    """Pull the places of a part that are nearest to a contact of its neighbour."""
    there = contact.points + other.moved(contact.points, contact.patches)
    face, weights, place = own.nearest(there, contact.normals)
    corners = own.faces[face]
    points = np.einsum("pc,pcd->pd", weights, each.part.verts[corners])
    patches = each.part.patches[corners[:, 0]]
    return _pull(each, points, patches, there - contact.offsets - place, there - place, contact)


def _pull(
    each: PlacedPart, points: _Floats, patches: _Index, way: _Floats, offsets: _Floats, contact: Contact
) -> tuple[Pull | None, float]:
    """Return the pull that closes a gap, if there is one, and how wide the gap is."""
    # All points of a contact go the same way, so that the end of a leg keeps its shape.
    together = way.mean(0)
    now, before = (float(np.linalg.norm(each, axis=1).mean()) for each in (offsets, contact.offsets))
    apart = max(now - before, 0.0)
    if not _STILL < float(np.linalg.norm(together)) < _REACH:
        return None, apart
    base = each.roughly(points)
    target = points + each.moved(points, patches) + together
    return Pull(base, target, patches, _CONTACT_WEIGHT), apart


def _beyond(each: PlacedPart, other: PlacedPart, surfaces: Mapping[int, PlacedSurface]) -> float:
    """Return how far a part goes into another one, more than where they touch in its member."""
    deepest, own, target = 0.0, surfaces[each.number], surfaces[other.number]
    for contact in each.shape.contacts(each.number, other.number):
        here = contact.points + each.moved(contact.points, contact.patches)
        if np.linalg.norm(target.nearest(here, contact.normals)[2] - here, axis=1).mean() < _REACH:
            points = each.part.beside(here, contact.patches, own.verts)
            deepest = max(deepest, depth_beyond(target, points, contact.normals) - contact.depth)
    return deepest


def sewn(placed: list[PlacedPart]) -> dict[int, _Floats]:
    """Return how far the vertices of each part move; where two parts of one member were cut apart, to one place."""
    ways = {each.number: each.moved(each.part.verts, each.part.patches) for each in placed}
    for member in {each.member for each in placed}:
        own = [each for each in placed if each.member == member]
        owner = np.repeat(np.arange(len(own)), [len(each.part.verts) for each in own])
        place = np.unique(np.concatenate([each.part.verts for each in own]), axis=0, return_inverse=True)[1].reshape(-1)
        shared = np.bincount(np.unique(np.stack([place, owner], 1), axis=0)[:, 0]) > 1
        # Parts that may not move decide where the others go.
        weight = np.where([each.embedding is None for each in own], _FIRM, 1.0)[owner]
        way = np.concatenate([ways[each.number] for each in own])
        total = np.bincount(place, weight)
        mean = np.stack([np.bincount(place, weight * each) / total for each in way.T], 1)
        for number, each in enumerate(own):
            if each.embedding is not None:
                rows = owner == number
                ways[each.number] = np.where(shared[place[rows], None], mean[place[rows]], way[rows])
    return ways


def _cofactors(maps: _Floats) -> _Floats:
    a, b, c = maps[:, 0], maps[:, 1], maps[:, 2]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)


def _directions(maps: _Floats, vectors: _Floats) -> _Floats:
    """Return the unit vectors that maps (P, 3, 3) make of directions (P, 3)."""
    moved = np.einsum("pij,pj->pi", maps, vectors)
    length = np.linalg.norm(moved, axis=1, keepdims=True)
    return np.asarray(np.where(length > 1e-12, moved / np.maximum(length, 1e-12), vectors))
