"""Make a shape out of parts of members: choose them, bring them to the shape's proportions, and make neighbours meet.

A part is scaled along the axes to its points of the shape. Then each place where it touches a neighbour in its own
member goes to that neighbour here, with the offset that it has there, and what stands on the ground stays on it; the
rest of the part follows smoothly (`placing`). What is left, since the two are not of one form, is bent; what would go
deeper into the neighbour than in its member is pushed out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.assets import Asset
from meshdeform.assets.assemble import AssetPart
from meshdeform.kinds.families.family_file import FamilyFile
from meshdeform.kinds.families.members import (
    ONE_SIDE,
    Contact,
    MemberPart,
    MemberShape,
    PlacedSurface,
    depth_beyond,
    reach_aside,
    turned,
)
from meshdeform.kinds.families.placing import PartFloor, PartJoint, PartSeam, Placing, axis_fit
from meshdeform.kinds.families.sampling import Drawn

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_FAR, _LEAST_FAR = 2.5, 0.04
"""Points farther from their places than so many times the median, and than so many diagonals, are no match."""
_FEWEST = 4
_SEAM, _MOST_BENT = 0.08, 0.03
"""How far from a place what is bent with it reaches, and how far a place may go so, in diagonals."""
_STILL = 1e-4
"""Gaps below this share of the diagonal are none."""
_REACH, _OTHER = 0.15, 0.05
"""A neighbour farther than the first share of the diagonal is another one than in the member, and is not met; a part
that is no neighbour there is met within the second."""
_MEETINGS, _OFFERS, _GOOD, _BESIDE = 3, 3, 0.008, 0.06
_FIRM = 1e9
"""Weight of a vertex of a part that may not move, beside one of a part that may."""
_KEPT = 4


@dataclass
class PlacedPart:
    """A part of a member on its way to its place; all in the frame."""

    # The part, and the member that it is from
    number: int
    member: int
    shape: MemberShape
    placing: Placing
    still: bool = False  # whether it may not move
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

    def moved(self, points: _Floats, patches: _Index) -> _Floats:
        """Return the displacement (P, 3) of points of the member."""
        return self.placing.moved(points, patches)

    def surface(self) -> PlacedSurface:
        """Return the part in its place."""
        part = self.part
        return PlacedSurface(part.verts + self.moved(part.verts, part.patches), part.faces)


@dataclass(frozen=True)
class Assembly:
    """A shape made of parts."""

    parts: list[PlacedPart]
    pieces: list[AssetPart]  # for `assets.assemble`
    loose: list[int]  # parts that touch no other part, because no member says where they would


@dataclass
class _Site:
    """A place where a part touches another one in its member, and its joint."""

    neighbour: int
    contact: Contact
    joint: PartJoint
    met: int = -1  # the part that it meets here


@dataclass
class _Standing:
    """What is in place already."""

    parts: list[PlacedPart] = field(default_factory=list)
    surfaces: dict[int, PlacedSurface] = field(default_factory=dict)

    def nearest(self, site: _Site, here: _Floats) -> tuple[int, _Floats] | None:
        """Return the part that a place meets, its neighbour of the member or what is nearest, and the places (P, 3)."""
        found = {}
        for number, surface in self.surfaces.items():
            place = surface.nearest(here, site.contact.normals)[2]
            found[number] = place, float(np.linalg.norm(here - place, axis=1).mean())
        if not found:
            return None
        own = found.get(site.neighbour)
        if own and own[1] < _REACH:
            return site.neighbour, own[0]
        number = min(found, key=lambda each: found[each][1])
        return (number, found[number][0]) if found[number][1] < _OTHER else None


class Assembler:
    """Makes shapes of a family out of parts of its members.

    Parameters
    ----------
    load : callable
        Returns the asset of a member.
    """

    def __init__(self, family: FamilyFile, load: Callable[[int], Asset]) -> None:
        self.family, self._load = family, load
        self._shapes: dict[int, MemberShape] = {}

    def shape(self, member: int) -> MemberShape:
        """Return a member, and keep the last few."""
        if member not in self._shapes:
            while len(self._shapes) >= _KEPT:
                del self._shapes[next(iter(self._shapes))]
            self._shapes[member] = MemberShape(self.family, member, self._load(member))
        return self._shapes[member]

    def chosen(self, draw: Drawn) -> dict[int, list[int]]:
        """Return the members for each part that have points of it that the shape has, in the order of the draw."""
        there = self.family.exists & draw.exists
        choice = dict[int, list[int]]()
        for part, members in draw.sources.items():
            own = np.asarray(there[:, self.family.labels == part].any(axis=1))
            can = [each for each in members if own[each] and (self.family.segments[each] == part).any()]
            if can:
                choice[part] = can
        return choice

    def assemble(
        self,
        points: _Floats,
        exists: NDArray[np.bool_],
        choice: Mapping[int, Sequence[int]],
        *,
        kept: Collection[int] = (),
        diagonal: float,
        centre: _Floats,
    ) -> Assembly:
        """Bring the chosen parts to the points, and move each to its neighbours that are in place already.

        Parameters
        ----------
        points : (K, 3) float64
            In the frame.
        exists : (K,) bool
        choice : mapping
            For each part the members that may give it: the first few are tried until one meets its neighbours.
        kept : collection of int
            Parts that stay exactly as they are in their member.
        diagonal : float
            Of the frame in units of the result.
        centre : (3,) float64
        """
        order = self._in_order(points, exists, list(choice), kept)
        first = [self._placed(points, exists, part, choice[part][0], part in kept) for part in order]
        ground = _ground(first)
        standing, loose = _Standing(), list[int]()
        for each in first:
            best, met = self._best(each, choice[each.number], standing, ground, (points, exists))
            if not met and standing.parts and not best.still:
                loose.append(best.number)
            standing.parts.append(best)
            standing.surfaces[best.number] = best.surface()
        placed = sorted(standing.parts, key=lambda each: list(choice).index(each.number))
        for each in placed:
            others = [other for other in placed if other is not each]
            each.penetration = max((_beyond(each, other, standing.surfaces) for other in others), default=0.0)
        ways = sewn(placed)
        return Assembly(placed, [self._piece(each, ways[each.number], diagonal, centre) for each in placed], loose)

    def _best(
        self,
        first: PlacedPart,
        members: Sequence[int],
        standing: _Standing,
        ground: float | None,
        shape: tuple[_Floats, NDArray[np.bool_]],
    ) -> tuple[PlacedPart, bool]:
        """Return the part of the first of some members that meets what is in place, or of that which nearly does."""
        best, sites, least = first, list[_Site](), np.inf
        for member in members[:_OFFERS]:
            each = first if member == first.member else self._placed(*shape, first.number, member, False)
            found = _meet(each, standing, ground)
            surfaces = {**standing.surfaces, each.number: each.surface()}
            fault = max([each.gap, *(_beyond(each, other, surfaces) for other in standing.parts)])
            fault += 0.0 if found or not standing.parts else _OTHER
            if fault < least:
                best, sites, least = each, found, fault
            if fault < _GOOD or each.still:
                break
        if not best.still:
            _bend(best, sites, standing)
        return best, bool(sites)

    def _placed(self, points: _Floats, exists: NDArray[np.bool_], part: int, member: int, kept: bool) -> PlacedPart:
        family, shape = self.family, self.shape(member)
        common = exists & family.exists[member] & (family.labels == part)
        if kept or int(common.sum()) < 1:
            return PlacedPart(part, member, shape, Placing(np.ones(3), np.zeros(3)), still=True)
        scale, shift, distance = _rough_fit(family.points[member, common], points[common])
        return PlacedPart(part, member, shape, Placing(scale, shift), distance=distance)

    def _in_order(
        self, points: _Floats, exists: NDArray[np.bool_], parts: list[int], kept: Collection[int]
    ) -> list[int]:
        """Return the parts: what may not move, then what is beside most others, then those of most points."""
        own = {part: points[exists & (self.family.labels == part)] for part in parts}
        near = {
            part: sum(
                len(own[part]) and len(own[other]) and cKDTree(own[part]).query(own[other])[0].min() < _BESIDE
                for other in parts
            )
            for part in parts
        }
        by_size = sorted(parts, key=lambda part: (-near[part], -len(own[part])))
        return sorted([by_size[0], *sorted(by_size[1:], key=lambda part: -len(own[part]))], key=lambda p: p not in kept)

    def _piece(self, each: PlacedPart, moved: _Floats, diagonal: float, centre: _Floats) -> AssetPart:
        shape, part, surface = each.shape, each.part, each.shape.asset.surface
        positions, normals, tangents = surface.positions.copy(), surface.normals.copy(), surface.tangents.copy()
        if shape.turn == 0 and diagonal == shape.diagonal and np.array_equal(centre, shape.centre):
            positions[part.rows] += moved * diagonal
        else:
            positions[part.rows] = (part.verts + moved) * diagonal + centre
        if moved.any() or shape.turn != 0:
            maps = each.placing.linear(part.verts, part.patches)
            normals[part.rows] = _directions(_cofactors(maps), turned(normals[part.rows], shape.turn))
            tangents[part.rows, :3] = _directions(maps, turned(tangents[part.rows, :3], shape.turn))
        extras = {"part": self.family.parts[each.number], "member": self.family.names[each.member]}
        return AssetPart(
            shape.asset, part.triangles, positions, normals, tangents, extras["part"], {"meshdeform": extras}
        )


def _rough_fit(source: _Floats, target: _Floats) -> tuple[_Floats, _Floats, float]:
    """Return the scale and the shift that take points to others, and the root mean square distance that remains."""
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
    return scale, shift, float(np.sqrt((apart**2).mean()))


def _ground(placed: list[PlacedPart]) -> float | None:
    """Return the height on which the parts stand, or None: none stands on the ground of its member."""
    heights = [
        (contact.points + each.moved(contact.points, contact.patches) - contact.offsets)[:, 1].mean()
        for each in sorted(placed, key=lambda each: not each.still)
        for contact in each.shape.feet(each.number)
    ]
    if not heights:
        return None
    still = [each for each in placed if each.still and each.shape.feet(each.number)]
    return float(heights[0] if still else np.mean(heights))


def _meet(each: PlacedPart, standing: _Standing, ground: float | None) -> list[_Site]:
    """Move the joints of a part to what is in place and to the ground, measure the gaps; return where it met any."""
    sites = [_site(each, other, c) for other in each.shape.present for c in each.shape.contacts(each.number, other)]
    feet = [_site(each, -1, contact) for contact in each.shape.feet(each.number)]
    if not each.still:
        if standing.parts:
            each.placing.joints.extend(site.joint for site in sites)
        for _ in range(_MEETINGS):
            for site in sites:
                way = _way(each, site, standing)[0]
                site.joint.way = site.joint.way + way
            used = [site.joint for site in sites if site.met >= 0]
            each.placing.joints[:] = used
            _stand(each, feet, ground)
    gaps = [_way(each, site, standing)[1] for site in sites if site.met >= 0 or each.still]
    each.gap = max(gaps, default=0.0)
    return [site for site in sites if site.met >= 0]


def _site(each: PlacedPart, neighbour: int, contact: Contact) -> _Site:
    points = each.placing.roughly(contact.points)
    centre = points.mean(0)
    radius = float(np.linalg.norm(points - centre, axis=1).max())
    return _Site(neighbour, contact, PartJoint(centre, radius, int(contact.patches[0])))


def _way(each: PlacedPart, site: _Site, standing: _Standing) -> tuple[_Floats, float]:
    """Return the way (3,) that closes the gap at a site, and how wide the gap is."""
    contact = site.contact
    here = contact.points + each.moved(contact.points, contact.patches)
    found = standing.nearest(site, here)
    if found is None:
        site.met = -1
        return np.zeros(3), 0.0
    site.met, place = found
    whole = _of_one_piece(each, site, standing)
    # All points of a contact go the same way, so that the end of a leg keeps its shape.
    way = (place + contact.offsets - here).mean(0)
    now, before = (float(np.linalg.norm(apart, axis=1).mean()) for apart in (here - place, contact.offsets))
    return way * (float(np.linalg.norm(way)) > _STILL), 0.0 if whole else max(now - before, 0.0)


def _bend(each: PlacedPart, sites: list[_Site], standing: _Standing) -> None:
    """Bend the places of a part that its joints leave off what they meet, and push out what goes too deep into it."""
    sites = [site for site in sites if not _of_one_piece(each, site, standing)]
    for site in sites:
        contact = site.contact
        here = contact.points + each.moved(contact.points, contact.patches)
        ways = standing.surfaces[site.met].nearest(here, contact.normals)[2] + contact.offsets - here
        length = np.linalg.norm(ways, axis=1, keepdims=True)
        ways *= np.minimum(1.0, _MOST_BENT / np.maximum(length, _STILL))
        if length.max() > _STILL:
            each.placing.seams.append(PartSeam(here, ways, site.joint.patch, _SEAM))
    for site in sites:
        contact, surface = site.contact, standing.surfaces[site.met]
        normal = contact.normals.mean(0)
        if (length := float(np.linalg.norm(normal))) < ONE_SIDE:
            continue
        normal /= length
        here = contact.points + each.moved(contact.points, contact.patches)
        around = each.part.beside(here, contact.patches, each.surface().verts)
        excess = min(depth_beyond(surface, around, contact.normals) - contact.depth, _MOST_BENT)
        if excess > _STILL:
            place = surface.nearest(here, contact.normals)[2].mean(0) - contact.depth * normal
            floor = PartFloor(place, normal, reach_aside(here, normal), excess, site.joint.patch)
            each.placing.seams.append(floor)
    each.gap = max((_way(each, site, standing)[1] for site in sites), default=0.0)


def _of_one_piece(each: PlacedPart, site: _Site, standing: _Standing) -> bool:
    """Return whether a part and what it meets were cut out of one piece of a mesh, along which they are sewn."""
    other = next(part for part in standing.parts if part.number == site.met)
    return each.member == other.member and each.shape.of_one_piece(each.number, other.number)


def _stand(each: PlacedPart, feet: list[_Site], ground: float | None) -> None:
    """Add the joints that keep the feet of a part on the ground, beside those that it has."""
    if ground is None:
        return
    for foot in feet:
        contact = foot.contact
        here = contact.points + each.moved(contact.points, contact.patches)
        aside = (here - each.placing.roughly(contact.points)).mean(0)
        down = ground - float((here - contact.offsets)[:, 1].mean())
        foot.joint.way = aside + (np.array([0.0, down, 0.0]) if abs(down) > _STILL else 0.0)
    each.placing.joints.extend(foot.joint for foot in feet if foot.joint.way.any())


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
        weight = np.where([each.still for each in own], _FIRM, 1.0)[owner]
        way = np.concatenate([ways[each.number] for each in own])
        total = np.bincount(place, weight)
        mean = np.stack([np.bincount(place, weight * each) / total for each in way.T], 1)
        for number, each in enumerate(own):
            if not each.still:
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
