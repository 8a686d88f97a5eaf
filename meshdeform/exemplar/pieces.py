"""Divide surfaces into pieces, and find which piece of one becomes which piece of another.

A piece is what is of one part and hangs together: a leg, a wheel, the whole body. Faces of one part hang together
along edges, and where they nearly touch on one side of the mirror plane. Pieces of one part are matched by the middles
of their boxes, relative to the box of the whole, (x, y, z) weighed by (1.5, 0.5, 1), at the least total distance.

Source: Kuhn 1955, The Hungarian method for the assignment problem.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.exemplar.alike import MANY, TWO_SIDED, grows_from, large_parts, made_alike
from meshdeform.exemplar.kinds import is_built, is_living
from meshdeform.exemplar.shapes import Shape
from meshdeform.geometry.mesh import face_areas
from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.cells import connected, neighbouring_faces
from meshdeform.reading.result import NO_PART
from meshdeform.reading.samples import spread
from meshdeform.vocabulary.solids import PART_NAMES, usual_parts_of

__all__ = ["Matching", "Pieces", "matched", "pieces_of"]

_SAMPLES, _TOUCHING = 4000, 0.015
_MIDDLE = 0.15
"""Share of its width within which the mean of a piece is in the middle."""
_MOST = 8
"""Of a part that has more pieces, such as leaves, all are one."""
_STRADDLES, _BETWEEN, _LITTLE = 0.25, 0.12, 0.1
"""A piece has two halves if each side has this share of its area, and this strip of its width little of it."""
_SMALL = 0.05
"""Share of the largest piece of its part under which a piece goes to the nearest other."""
_TOO_THIN = frozenset(("tusk", "feeler"))
"""What cannot be drawn out of what has none."""
_AXES = np.array([1.5, 0.5, 1.0])


@dataclass(frozen=True)
class Pieces:
    """The N pieces of a surface: the name of each, and the piece (F,) int64 of each face, -1 of none."""

    names: tuple[str, ...]
    of_face: Index

    def __len__(self) -> int:
        return len(self.names)

    def named(self, name: str) -> list[int]:
        """Return the numbers of the pieces that have a name."""
        return [number for number, own in enumerate(self.names) if own == name]

    def joined(self, into: Mapping[int, int]) -> Pieces:
        """Return the pieces with some of them counted as others."""
        to = np.array([into.get(number, number) for number in range(len(self))])
        kept = np.unique(to)
        of_face = np.where(self.of_face >= 0, np.searchsorted(kept, to)[self.of_face], -1)
        return Pieces(tuple(self.names[number] for number in kept), of_face)


@dataclass(frozen=True)
class Matching:
    """The pieces of a source and of its goal under common names, and what becomes of them.

    `partner` (N,) int64: the piece of the goal that each piece of the source becomes, or -1. `parent` (M,) int64: the
    piece of the source that each piece of the goal is fitted by: its partner, or the one from which it grows; -1 if it
    is to be left out. `grows` (M,): whether a piece of the goal has no partner.
    """

    source: Pieces
    goal: Pieces
    partner: Index
    parent: Index
    grows: Flags


def pieces_of(shape: Shape, names: Mapping[str, str]) -> Pieces:
    """Divide a shape into pieces; `names` tells what each of its parts is called."""
    known = [PART_NAMES.index(part) for part in names]
    called = sorted(set(names.values()))
    family = np.full(len(PART_NAMES) + 2, -1)
    family[known] = [called.index(name) for name in names.values()]
    of_name = np.where(shape.labels >= 0, family[shape.labels], -1)
    areas = face_areas(shape.verts, shape.faces)
    centres = shape.verts[shape.faces].mean(1)
    own_names: list[str] = []
    of_face = np.full(len(shape.faces), -1, np.int64)
    links = neighbouring_faces(shape.faces, len(shape.verts))[0]
    touching = _touching(shape)
    for number, name in enumerate(called):
        rows = np.flatnonzero(of_name == number)
        if not len(rows):
            continue
        own = np.zeros(len(rows), np.int64)
        if name in MANY:
            own = _instances(rows, links, touching, centres, areas, two_sided=name in TWO_SIDED)
        of_face[rows] = len(own_names) + own
        own_names += [name] * (int(own.max()) + 1)
    return Pieces(tuple(own_names), of_face)


def _touching(shape: Shape) -> Index:
    """Return pairs (P, 2) of faces of one part that nearly touch."""
    samples = spread(shape.verts, shape.faces, _SAMPLES, 4)
    pairs = cKDTree(samples.positions).query_pairs(_TOUCHING, output_type="ndarray").astype(np.int64)
    return np.asarray(samples.faces[pairs], np.int64)


def _instances(rows: Index, links: Index, touching: Index, centres: Floats, areas: Floats, *, two_sided: bool) -> Index:
    """Return the number of the piece (R,) of each of the faces of one part."""
    row_of = np.full(len(centres), -1)
    row_of[rows] = np.arange(len(rows))
    along = row_of[links]
    along = along[(along >= 0).all(1)]
    x = centres[rows, 0]
    if two_sided:
        own = connected(len(rows), along)
        half = _left_and_right(own, x, areas[rows])
        along = along[~half[along[:, 0]] | (np.sign(x[along[:, 0]]) == np.sign(x[along[:, 1]]))]
    own = connected(len(rows), along)
    near = row_of[touching]
    near = near[(near >= 0).all(1)]
    side = _sides(own, x, areas[rows])
    near = near[side[own[near[:, 0]]] * side[own[near[:, 1]]] >= 0] if two_sided else near
    own = connected(len(rows), np.concatenate([along, near]))
    if own.max() > _MOST:
        return np.zeros(len(rows), np.int64)
    return _without_crumbs(own, centres[rows], areas[rows])


def _left_and_right(own: Index, x: Floats, areas: Floats) -> Flags:
    """Return which faces (R,) are of a piece that is really a left one and a right one, which meet in the middle."""
    total = np.maximum(np.bincount(own, areas), 1e-300)
    left = np.bincount(own, areas * (x < 0)) / total
    reach = np.zeros(len(total))
    np.maximum.at(reach, own, np.abs(x))
    between = np.bincount(own, areas * (np.abs(x) < _BETWEEN * reach[own])) / total
    return np.asarray(((np.minimum(left, 1 - left) > _STRADDLES) & (between < _LITTLE))[own])


def _sides(own: Index, x: Floats, areas: Floats) -> Floats:
    """Return the side of each piece: -1, 0 if it is in the middle, or 1."""
    mean = np.bincount(own, areas * x) / np.maximum(np.bincount(own, areas), 1e-300)
    low, high = np.full(len(mean), np.inf), np.full(len(mean), -np.inf)
    np.minimum.at(low, own, x)
    np.maximum.at(high, own, x)
    return np.where(np.abs(mean) < _MIDDLE * (high - low), 0.0, np.sign(mean))


def _without_crumbs(own: Index, centres: Floats, areas: Floats) -> Index:
    """Give pieces that are small beside the largest to the nearest of the others."""
    total = np.bincount(own, areas)
    small = total < _SMALL * total.max()
    if small.any():
        kept = np.flatnonzero(~small[own])
        crumbs = np.flatnonzero(small[own])
        own = own.copy()
        own[crumbs] = own[kept[cKDTree(centres[kept]).query(centres[crumbs])[1]]]
    return np.asarray(np.unique(own, return_inverse=True)[1], np.int64)


def _middles(shape: Shape, pieces: Pieces) -> Floats:
    """Return the middle (N, 3) of each piece in the box of all, which reaches from -1/2 to 1/2."""
    if not len(pieces):
        return np.zeros((0, 3))
    areas, centres = face_areas(shape.verts, shape.faces) + 1e-12, shape.verts[shape.faces].mean(1)
    used = shape.verts[shape.faces[pieces.of_face >= 0]].reshape(-1, 3)
    low, high = used.min(0), used.max(0)
    own = np.flatnonzero(pieces.of_face >= 0)
    mass = np.bincount(pieces.of_face[own], areas[own], len(pieces))
    sums = [np.bincount(pieces.of_face[own], (areas * centres[:, axis])[own], len(pieces)) for axis in range(3)]
    return np.asarray((np.stack(sums, 1) / mass[:, None] - (low + high) / 2) / np.maximum(high - low, 1e-9))


def _completed(shape: Shape) -> Shape:
    """Return a shape whose unknown faces are of the one large part of its noun that was not found, if it is one."""
    unknown = shape.labels == NO_PART
    if is_living(shape.noun) or not unknown.any():
        return shape
    missing = large_parts(usual_parts_of(shape.noun)) - _parts(shape)
    if len(missing) != 1:
        return shape
    labels = np.where(unknown, PART_NAMES.index(missing.pop()), shape.labels)
    return Shape(shape.noun, shape.verts, shape.faces, labels, shape.solids)


def _parts(shape: Shape) -> set[str]:
    return {PART_NAMES[number] for number in np.unique(shape.labels) if number >= 0}


def matched(source: Shape, goal: Shape) -> Matching:
    """Divide both shapes into pieces and match them."""
    source = _completed(source)
    own_names, goal_names = made_alike(_parts(source), _parts(goal), source.noun, goal.noun)
    own, other = pieces_of(source, own_names), pieces_of(goal, goal_names)
    if is_built(source.noun) and is_built(goal.noun):
        own, other = _legs_as_one(source, own, other)
    own = _joined_where_fewer(source, own, other)
    partner = _partners(_middles(source, own), _middles(goal, other), own, other)
    parent = _parents(goal, own, other, partner)
    grows = ~np.isin(np.arange(len(other)), partner)
    return Matching(own, other, partner, parent, grows)


def _legs_as_one(source: Shape, own: Pieces, other: Pieces) -> tuple[Pieces, Pieces]:
    """Take the legs of furniture as one piece where they are joined, or of unlike number."""
    mine, others = own.named("leg"), other.named("leg")
    if not mine or not others:
        return own, other
    pairs = own.of_face[neighbouring_faces(source.faces, len(source.verts))[0]]
    joined = (np.isin(pairs, mine).all(1) & (pairs[:, 0] != pairs[:, 1])).any()
    if len(mine) == len(others) and not joined:
        return own, other
    return own.joined(dict.fromkeys(mine, mine[0])), other.joined(dict.fromkeys(others, others[0]))


def _joined_where_fewer(source: Shape, own: Pieces, other: Pieces) -> Pieces:
    """Join ears, or horns, of one side where the goal has fewer."""
    for name in ("ear", "horn"):
        mine = own.named(name)
        if len(mine) > len(other.named(name)) > 0:
            side = np.sign(_middles(source, own)[mine, 0])
            into = {
                number: min(k for k, at in zip(mine, side, strict=True) if at == own_side)
                for number, own_side in zip(mine, side, strict=True)
            }
            own = own.joined(into)
    return own


def _partners(own_middles: Floats, other_middles: Floats, own: Pieces, other: Pieces) -> Index:
    from scipy.optimize import linear_sum_assignment  # takes long to import, and what is moulded has no pieces

    partner = np.full(len(own), -1, np.int64)
    for name in sorted(set(own.names) & set(other.names)):
        mine, others = own.named(name), other.named(name)
        cost = np.linalg.norm((own_middles[mine][:, None] - other_middles[others][None]) * _AXES, axis=2)
        for one, two in zip(*linear_sum_assignment(cost), strict=True):
            partner[mine[one]] = others[two]
    return partner


def _parents(goal: Shape, own: Pieces, other: Pieces, partner: Index) -> Index:
    """Return the piece of the source (M,) by which each piece of the goal is fitted."""
    parent = np.full(len(other), -1, np.int64)
    parent[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    centres = goal.verts[goal.faces].mean(1)
    positions = [centres[other.of_face == number] for number in range(len(other))]
    fitted = [number for number in range(len(other)) if parent[number] >= 0]
    for number in range(len(other)):
        name = other.names[number]
        if parent[number] >= 0 or name in own.names or name in _TOO_THIN:
            continue
        base = grows_from(name, {other.names[k] for k in fitted})
        bases = [k for k in fitted if other.names[k] == base]
        if bases:
            away = [np.percentile(cKDTree(positions[k]).query(positions[number])[0], 5) for k in bases]
            parent[number] = parent[bases[int(np.argmin(away))]]
    return parent
