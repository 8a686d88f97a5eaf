"""Move parts of an asset that is the wished noun already as an attribute moves those of its nearest member.

Two members of one generator state, with and without the attribute, have like faces in one order: they are twins. Of
the solids of one part that touch on one side, the attribute moves the vertices by the exact affine map T, in the frame
in which the largest part of the member stays. With P the map of the solid onto the member as it was placed and posed,
and A the map of the asset's piece to the member's (`affine_maps`), a place x of the asset goes to

    sum_i w_i(x) A_i^-1 P_i T_i P_i^-1 A_i x,

w the blended weights of the pieces (`blending`), and each map is moved so that pieces that touch still do. What carries
no name goes with the piece that is nearest, so that what is attached stays attached. All that stands on the ground is
lifted or lowered as a whole until it stands there again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from meshdeform.exemplar.affine_maps import AffineMaps, Cloud, Manner, articulated, touching
from meshdeform.exemplar.blending import blend_weights
from meshdeform.exemplar.choosing import AFLOAT, Exemplar, exemplars
from meshdeform.exemplar.kinds import is_boxed, is_living
from meshdeform.exemplar.pieces import Pieces, neighbours, pieces_of
from meshdeform.exemplar.shapes import Shape, Wish
from meshdeform.exemplar.symmetry import symmetry_axes
from meshdeform.nouns.forms import is_able
from meshdeform.nouns.labels import Floats, Index, LabelledMember
from meshdeform.nouns.solids import PART_NAMES, part_label
from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.reading.banks import candidate_member, twin_member
from meshdeform.reading.groups import joined_solids
from meshdeform.reading.result import GROUND
from meshdeform.reading.samples import hidden, spread

__all__ = ["twin"]

_CANDIDATES = 6
_SAMPLES, _MEMBER_SAMPLES = 1600, 3000
_EXACT, _TOUCHING = 1e-6, 0.03
_TIE_SAMPLES, _SPACING, _FAR = 4000, 0.002, 0.12
_NEAR = 0.03
_PRIOR, _BY_CHANCE, _FIXED = 0.01, 0.03, 1e6
"""What a piece's own place weighs beside a tie, and a tie that the member has not."""
_STILL = 0.004
"""Share of the member's diagonal by which a solid must move to count as moved."""
_AXES = np.array([1.5, 0.5, 1.0])


def twin(source: Shape, wish: Wish, *, cache: Path | None = None) -> Floats | None:
    """Return the vertices (V, 3) of an asset with the wished attributes of its parts.

    Those of the whole are not looked at. Without any of parts the vertices come back as they are; None: the asset is
    not of the wished noun, or it has not the part, or no member can have the attribute.

    Parameters
    ----------
    source : Shape
        The asset in its frame, with the parts of its faces.
    wish : Wish
        The same noun, with attributes.
    cache : Path, optional
        A folder in which tables of members are kept (`reading.banks`).
    """
    attributes = tuple(each for each in wish.attributes if each.part != "whole")
    if not attributes:
        return source.verts.copy()
    if source.noun != wish.noun:
        return None
    for exemplar in exemplars(source, Wish(wish.noun), _CANDIDATES, cache=cache):
        if not is_able(str(exemplar.told["form"]), attributes):
            continue
        twins = _twins(wish.noun, exemplar, attributes)
        if twins is not None:
            return _moved(source, exemplar.shape, twins)
    return None


@dataclass(frozen=True)
class _Twins:
    """What attributes do to a member: clusters (F,) of its faces, and the map (4, 4) of each that moves.

    The maps are of the member as it was placed on the asset. `parts`: the labels that the attributes name.
    """

    cluster: Index
    maps: Mapping[int, Floats]
    parts: tuple[int, ...]


def _twins(noun: str, exemplar: Exemplar, attributes: tuple[Attribute, ...]) -> _Twins | None:
    """Return what attributes do to an exemplar, or None if the two members are no twins."""
    number = int(str(exemplar.told["number"]))
    plain, other = candidate_member(noun, number, ()), twin_member(noun, number, attributes)
    if len(plain.faces) != len(other.faces):
        return None
    own = joined_solids(plain)
    of_vert = own[plain.solids]
    verts = np.empty_like(plain.verts)
    verts[plain.faces] = other.verts[other.faces]  # boxes number their vertices by their places
    goal = _in_one_frame(plain, verts, of_vert)
    diagonal = float(np.linalg.norm(np.ptp(plain.verts, axis=0)))
    maps = {}
    for cluster in range(int(own.max()) + 1):
        rows = np.flatnonzero(of_vert == cluster)
        if float(np.abs(goal[rows] - plain.verts[rows]).max()) >= _STILL * diagonal:
            onto, change = (_affine(plain.verts[rows], places[rows]) for places in (exemplar.shape.verts, goal))
            maps[cluster] = onto @ change @ np.linalg.inv(onto)
    parts = tuple(PART_NAMES.index(part_label(each.part)) for each in attributes)
    return _Twins(own[plain.solid_of_face], maps, parts)


def _in_one_frame(plain: LabelledMember, verts: Floats, of_vert: Index) -> Floats:
    """Return the twin's vertices (V, 3), scaled and moved so that as much as possible of the member stays.

    Members are scaled to one size when they are drawn, and so an attribute of one part changes all places.
    """
    best, most = verts, -1.0
    areas = _vertex_areas(plain)
    for cluster in range(int(of_vert.max()) + 1):
        rows = of_vert == cluster
        one, two = verts[rows], plain.verts[rows]
        scale = np.linalg.norm(two - two.mean(0)) / max(float(np.linalg.norm(one - one.mean(0))), 1e-12)
        placed = (verts - one.mean(0)) * scale + two.mean(0)
        stays = float(areas[np.abs(placed - plain.verts).max(1) < _EXACT].sum())
        if stays > most:
            best, most = placed, stays
    return np.asarray(best)


def _vertex_areas(member: LabelledMember) -> Floats:
    """Return the area (V,) around each vertex."""
    a, b, c = member.verts[member.faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.asarray(np.bincount(member.faces.ravel(), np.repeat(areas, 3), len(member.verts)), np.float64)


def _affine(places: Floats, goal: Floats) -> Floats:
    """Return the affine map (4, 4) that takes places (N, 3) nearest to others."""
    linear = np.linalg.lstsq(np.hstack([places, np.ones((len(places), 1))]), goal, rcond=None)[0]
    return np.vstack([linear.T, [0.0, 0.0, 0.0, 1.0]])


def _moved(source: Shape, member: Shape, twins: _Twins) -> Floats | None:
    """Return the vertices of the asset moved as the twins differ, or None if it has not what they move."""
    standing = source.labels != GROUND
    own = Shape(source.noun, source.verts, source.faces[standing], source.labels[standing])
    if any(not (own.labels == part).any() for part in twins.parts):
        return None
    link = _Link.between(own, member)
    cluster, piece = _clusters(own, member, twins, link)
    moves = {(int(k), int(p)) for k, p in zip(cluster, piece, strict=True) if int(k) in twins.maps}
    numbers = {pair: number for number, pair in enumerate(sorted(moves))}
    if not numbers:
        return None
    still = len(numbers)
    of_face = np.array([numbers.get((int(k), int(p)), still) for k, p in zip(cluster, piece, strict=True)])
    groups = [_Group(link.matrix(p), twins.maps[k]) for k, p in numbers]
    maps = _kept_together(groups, _ties(own, of_face, _contacts(member, twins, [k for k, _ in numbers])))
    weights = blend_weights(own.verts, own.faces, of_face, np.zeros(still + 1, bool))
    step = np.zeros_like(own.verts)
    for number, change in enumerate(maps):
        rows = np.flatnonzero(weights[:, number])
        places = own.verts[rows]
        step[rows] += weights[rows, number, None] * (places @ change[:3, :3].T + change[:3, 3] - places)
    verts = source.verts + step
    used = np.unique(own.faces)
    if source.noun not in AFLOAT:
        verts[used, 1] += float(source.verts[used, 1].min() - verts[used, 1].min())
    return np.asarray(verts)


def _contacts(member: Shape, twins: _Twins, clusters: Sequence[int]) -> Floats:
    """Return where some clusters, and all that stay as the last, touch each other in the member, else nan.

    (G + 1, G + 1, 3); a cluster that two groups share touches itself in its middle.
    """
    chosen = [*(twins.cluster == k for k in clusters), ~np.isin(twins.cluster, list(twins.maps))]
    places = [member.verts[np.unique(member.faces[rows])] for rows in chosen]
    contacts = np.full((len(places), len(places), 3), np.nan)
    for i, one in enumerate(places):
        for j, other in enumerate(places[:i]):
            if i < len(clusters) and clusters[i] == clusters[j]:
                contacts[i, j] = contacts[j, i] = one.mean(0)
            elif len(one) and len(other):
                away, nearest = cKDTree(other).query(one)
                close = away <= 1.02 * away.min() + _SPACING
                if away.min() < _TOUCHING:
                    contacts[i, j] = contacts[j, i] = (one[close] + other[nearest[close]]).mean(0) / 2
    return contacts


@dataclass(frozen=True)
class _Group:
    """Faces of the asset that move as one: their map (4, 4) to the member, `there`, and what moves them there."""

    there: Floats
    change: Floats

    @cached_property
    def back(self) -> Floats:
        """The map (4, 4) from the member."""
        return np.asarray(np.linalg.inv(self.there))

    @cached_property
    def map(self) -> Floats:
        """How the asset moves (4, 4)."""
        return np.asarray(self.back @ self.change @ self.there)


def _kept_together(groups: Sequence[_Group], ties: Sequence[_Tie]) -> Floats:
    """Return the maps (G, 4, 4) of groups, moved so that what touches is as far apart as it is in the member.

    With maps x -> L x + t, the sum over ties at places c of w |(L_i c + t_i) - (L_j c + t_j) - g|^2 and of
    0.01 |t_i - t_i0|^2 is least, g the gap T_i y - T_j y in the member, taken back to the asset; y is the mean of where
    the two take c on the member, or where two that move touch there, if that is far away.
    """
    still = len(groups)
    maps = np.array([*(group.map for group in groups), np.eye(4)])
    matrix, right = _PRIOR * np.eye(still + 1), np.zeros((still + 1, 3))
    matrix[still, still] = _FIXED
    right[:still] = _PRIOR * maps[:still, :3, 3]
    for tie in ties:
        pair = (tie.one, tie.other)
        known = [groups[number] for number in pair if number < still]
        there = np.mean([group.there @ np.append(tie.place, 1.0) for group in known], axis=0)
        if len(known) > 1 and float(np.linalg.norm(there[:3] - tie.contact)) > _FAR:  # never of one that is nan
            there[:3] = tie.contact
        moved = [groups[number].change @ there if number < still else there for number in pair]
        gap = np.mean([group.back[:3, :3] for group in known], axis=0) @ (moved[0] - moved[1])[:3]
        row = np.zeros(still + 1)
        row[list(pair)] = 1.0, -1.0
        matrix += tie.weight * np.outer(row, row)
        right += tie.weight * np.outer(row, gap - (maps[tie.one, :3, :3] - maps[tie.other, :3, :3]) @ tie.place)
    maps[:, :3, 3] = np.linalg.solve(matrix, right)
    return maps[:still]


class _Tie(NamedTuple):
    """A place (3,) at which two groups touch, that in the member, which may be nan, and what the tie weighs."""

    one: int
    other: int
    place: Floats
    contact: Floats
    weight: float


def _ties(own: Shape, of_face: Index, contacts: Floats) -> list[_Tie]:
    """Return where groups of faces touch; `contacts` (G + 1, G + 1, 3): where they do in the member.

    Those that share edges or touch in both are tied firmly, those that only happen to be near loosely. Of those that
    touch in the member alone the nearest are tied, as long as they join what nothing else does (Kruskal 1956, On the
    shortest spanning subtree of a graph).
    """
    samples = spread(own.verts, own.faces, _TIE_SAMPLES, 5)
    places = [samples.places[of_face[samples.faces] == group] for group in range(len(contacts))]
    borders = _borders(own, of_face)
    ties: list[_Tie] = []
    far: list[tuple[float, _Tie]] = []
    for i, j in combinations(range(len(contacts)), 2):
        contact, beside = contacts[i, j], not np.isnan(contacts[i, j]).any()
        if (i, j) in borders:
            ties.append(_Tie(i, j, borders[i, j].mean(0), contact, 1.0))
        elif len(places[i]) and len(places[j]):
            away, nearest = cKDTree(places[j]).query(places[i])
            close = away <= 1.02 * away.min() + _SPACING
            middle = (places[i][close] + places[j][nearest[close]]).mean(0) / 2
            tie = _Tie(i, j, middle, contact, 1.0 if beside else _BY_CHANCE)
            if away.min() < _NEAR:
                ties.append(tie)
            elif beside:
                far.append((float(away.min()), tie))
    return [*ties, *_joining(ties, [tie for _, tie in sorted(far, key=lambda pair: pair[0])], len(contacts))]


def _joining(ties: Sequence[_Tie], others: Iterable[_Tie], count: int) -> list[_Tie]:
    """Return those of other ties, in their order, that join groups which nothing before them joins."""
    whole = np.arange(count)
    for tie in ties:
        whole[whole == whole[tie.other]] = whole[tie.one]
    joining = []
    for tie in others:
        if whole[tie.one] != whole[tie.other]:
            whole[whole == whole[tie.other]] = whole[tie.one]
            joining.append(tie)
    return joining


@dataclass(frozen=True)
class _Link:
    """The maps of an asset's pieces to those of a member."""

    pieces: Pieces
    maps: AffineMaps
    known: Index

    @classmethod
    def between(cls, own: Shape, member: Shape) -> _Link:
        """Fit the pieces of an asset to those of a member."""
        shared = np.intersect1d(own.labels, member.labels)
        names = {PART_NAMES[number]: PART_NAMES[number] for number in shared}
        mine, others = pieces_of(own, names), pieces_of(member, names)
        if not is_living(own.noun):
            mine, others = _as_one_each(mine, others)
        samples = spread(own.verts, own.faces, _SAMPLES, 1)
        cloud = Cloud(samples.places, samples.normals, mine.of_face[samples.faces]).known()
        seen = spread(member.verts, member.faces, _MEMBER_SAMPLES, 2)
        if member.solids is not None:
            seen = seen.rows(~hidden(seen, member.solids[seen.faces]))
        goal = Cloud(seen.places, seen.normals, others.of_face[seen.faces]).known()
        partner = _partners(mine, others, cloud, goal)
        living = is_living(own.noun)
        planes = symmetry_axes((own.verts, own.faces), (member.verts, member.faces))
        manner = Manner(straight=not living, boxed=is_boxed(own.noun), mirrored=0 in planes)
        ties = touching(cloud, len(mine), _borders(own, mine.of_face))
        return cls(mine, articulated(cloud, goal, mine.names, partner, ties, manner), partner)

    def matrix(self, piece: int) -> Floats:
        """Return the map (4, 4) of a piece of the asset to the member."""
        linear = self.maps.linear[piece]
        shift = self.maps.maps[piece, :, 3] - linear @ self.maps.centres[piece]
        return np.vstack([np.hstack([linear, shift[:, None]]), [0.0, 0.0, 0.0, 1.0]])


def _as_one_each(mine: Pieces, others: Pieces) -> tuple[Pieces, Pieces]:
    """Take all pieces of a name as one where the two have unlike numbers of them, as a trestle has of legs."""
    for name in sorted(set(mine.names) & set(others.names)):
        one, two = mine.named(name), others.named(name)
        if len(one) != len(two):
            mine, others = mine.joined(dict.fromkeys(one, one[0])), others.joined(dict.fromkeys(two, two[0]))
    return mine, others


def _borders(own: Shape, of_face: Index) -> dict[tuple[int, int], Floats]:
    """Return the middles (P, 3) of the edges between two pieces; `of_face` (F,): the piece of each face, or -1."""
    pairs = neighbours(own.faces, len(own.verts))
    two = np.sort(of_face[pairs], 1)
    hit = (two[:, 0] != two[:, 1]) & (two[:, 0] >= 0)
    pairs, two = pairs[hit], two[hit]
    middles = own.verts[own.faces[pairs]].mean((1, 2))
    return {(int(i), int(j)): middles[(two == (i, j)).all(1)] for i, j in np.unique(two, axis=0)}


def _partners(mine: Pieces, others: Pieces, cloud: Cloud, goal: Cloud) -> Index:
    """Return the piece of the member (N,) that lies where each piece of the asset does, or -1."""
    partner = np.full(len(mine), -1, np.int64)
    for name in sorted(set(mine.names)):
        one = [k for k in mine.named(name) if (cloud.own == k).any()]
        two = [k for k in others.named(name) if (goal.own == k).any()]
        middles = [cloud.places[cloud.own == k].mean(0) for k in one], [goal.places[goal.own == k].mean(0) for k in two]
        if one and two:
            away = np.linalg.norm((np.array(middles[0])[:, None] - np.array(middles[1])) * _AXES, axis=2)
            rows, columns = linear_sum_assignment(away)
            partner[np.array(one)[rows]] = np.array(two)[columns]
    return partner


def _clusters(own: Shape, member: Shape, twins: _Twins, link: _Link) -> tuple[Index, Index]:
    """Return the cluster of the member (F,) with which each face of the asset moves, and the piece that tells how."""
    centres = own.verts[own.faces].mean(1)
    piece = link.pieces.of_face.copy()
    known = np.flatnonzero(piece >= 0)
    lost = np.flatnonzero(piece < 0)
    piece[lost] = piece[known[cKDTree(centres[known]).query(centres[lost])[1]]]
    label = np.where(link.pieces.of_face >= 0, own.labels, own.labels[known][0])
    label[lost] = label[known[cKDTree(centres[known]).query(centres[lost])[1]]] if len(lost) else label[lost]
    there = np.einsum("nij,nj->ni", link.maps.linear[piece], centres - link.maps.centres[piece])
    there += link.maps.maps[piece, :, 3]
    middles = member.verts[member.faces].mean(1)
    cluster = np.zeros(len(centres), np.int64)
    for number in np.unique(label):
        rows, theirs = np.flatnonzero(label == number), np.flatnonzero(member.labels == number)
        cluster[rows] = twins.cluster[theirs[cKDTree(middles[theirs]).query(there[rows])[1]]]
    return cluster, piece
