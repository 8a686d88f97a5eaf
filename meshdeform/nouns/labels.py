"""Members with a part's name on every face.

The solids of a member are its connected components, in order; its family names their faces, or `solids.LAYOUTS` does
by their order. A solid that is made of
several parts, such as a bottle, is divided between two of its rings. A neck ends where it enters the head: its faces
inside the head, or nearer to it than 0.03 of its least extent, are the head's.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from meshdeform.nouns.deformed import deformed
from meshdeform.nouns.families import FAMILIES, Part, Traits
from meshdeform.nouns.families.parts import rings_of
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.solids import PART_NAMES, layout, parent_of

__all__ = ["LabelledMember", "code", "labelled", "labelled_member", "labelled_solids", "solids_of"]

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

_INSIDE_THE_HEAD = 0.03
"""Share of the head's least extent within which faces of the neck count as the head's."""


def code(part: str) -> int:
    """Return the number of a part in `PART_NAMES`."""
    return PART_NAMES.index(part)


@dataclass(frozen=True)
class LabelledMember:
    """A member of a noun with the parts of its faces.

    `verts` (V, 3) float64 and `faces` (F, 3) int64 as in `families`: +Y up, facing +Z, farthest vertex at distance 1.
    `solids` (V,) int64: the solid of each vertex; what is a part of its own in a solid of several parts counts as a
    solid. `labels` (F,) int64: the part of each face, a place in `PART_NAMES`.
    """

    noun: str
    verts: Floats
    faces: Index
    solids: Index
    labels: Index

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """The names of its parts, by the alphabet."""
        return tuple(PART_NAMES[number] for number in np.flatnonzero(np.bincount(self.labels)))

    @cached_property
    def solid_of_face(self) -> Index:
        """The solid of each face, (F,) int64: that of its first corner."""
        return np.asarray(self.solids[self.faces[:, 0]])

    @cached_property
    def part_of_solid(self) -> Index:
        """The part that most faces of each solid have, (S,) int64."""
        votes = np.zeros((int(self.solids.max()) + 1, len(PART_NAMES)), np.int64)
        np.add.at(votes, (self.solid_of_face, self.labels), 1)
        return np.asarray(votes.argmax(1))

    def solids_named(self, part: str) -> Index:
        """Return the numbers of the solids of a part."""
        if part not in self.parts:
            return np.zeros(0, np.int64)
        return np.flatnonzero(self.part_of_solid == code(part))

    def carried(self, part: str) -> Flags:
        """Return the vertices (V,) of a part and of all that moves with it."""
        moving = {part}
        for name in self.parts:
            above: str | None = name
            while above is not None and above not in moving:
                above = parent_of(above, self.parts)
            if above is not None:
                moving.add(name)
        return np.isin(self.part_of_solid, [code(name) for name in moving])[self.solids]

    def moved(self, verts: Floats) -> LabelledMember:
        """Return the member with its vertices at other places."""
        return replace(self, verts=verts)


def labelled_member(
    noun: str, attributes: Iterable[Attribute], rng: np.random.Generator, traits: Traits | None = None
) -> LabelledMember:
    """Draw a member like `families.member`, with labels: the same generator state gives the same member.

    `traits`: Default: those of the attributes.
    """
    names = tuple(attributes)
    drawn = labelled(noun, FAMILIES[noun](rng, traits or Traits(names)))
    return drawn.moved(deformed(Part(drawn.verts, drawn.faces), names, rng).verts)


def labelled(noun: str, shape: Part) -> LabelledMember:
    """Name the faces of a shape that the family of a noun has drawn."""
    solids = solids_of(shape)
    if shape.labels is not None:
        return _named(noun, shape, shape.labels, solids)
    counts = np.bincount(solids[shape.faces[:, 0]])
    return labelled_solids(noun, shape, layout(noun, counts.tolist()), solids)


def labelled_solids(
    noun: str, shape: Part, pieces: Iterable[tuple[tuple[int, str], ...]], solids: Index
) -> LabelledMember:
    """Name the faces of a shape by the pieces (ring, part) of its solids; `solids` (V,) int64."""
    of_face = solids[shape.faces[:, 0]]
    labels = np.zeros(len(shape.faces), np.int64)
    own = solids.copy()
    for number, parts in enumerate(pieces):
        rows = np.flatnonzero(of_face == number)
        rings = rings_of(shape.faces[rows]) if len(parts) > 1 else np.zeros(len(rows), np.int64)
        for piece, (first, part) in enumerate(parts):
            labels[rows[rings >= first]] = code(part)
            if piece:
                own[np.unique(shape.faces[rows[rings >= first]])] = own.max() + 1
    member = LabelledMember(noun, shape.verts, shape.faces, own, labels)
    return replace(member, labels=_head_over_neck(member))


def _named(noun: str, shape: Part, labels: Index, solids: Index) -> LabelledMember:
    """Return a member whose family has named its faces: a solid of several parts counts as several."""
    own, of_face = solids.copy(), solids[shape.faces[:, 0]]
    firsts: dict[int, int] = {}
    for pair in np.unique(of_face * len(PART_NAMES) + labels).tolist():
        number, label = divmod(pair, len(PART_NAMES))
        if firsts.setdefault(number, label) != label:
            own[np.unique(shape.faces[(of_face == number) & (labels == label)])] = own.max() + 1
    member = LabelledMember(noun, shape.verts, shape.faces, own, labels)
    return replace(member, labels=_head_over_neck(member))


def solids_of(shape: Part) -> Index:
    """Return the connected component of each vertex, (V,) int64, in the order of the vertices."""
    edges = np.concatenate([shape.faces[:, :2], shape.faces[:, 1:]])
    graph = sparse.csr_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(len(shape.verts),) * 2)
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], np.int64)


def _head_over_neck(member: LabelledMember) -> Index:
    """Return the labels (F,) with the end of the neck that is inside the head named head."""
    if not {"neck", "head"} <= set(member.parts):
        return member.labels
    labels = member.labels.copy()
    head, neck = member.faces[labels == code("head")], np.flatnonzero(labels == code("neck"))
    a, b, c = member.verts[head].transpose(1, 0, 2)
    outward, centres = np.cross(b - a, c - a), member.verts[member.faces[neck]].mean(1)
    near = cKDTree((a + b + c) / 3).query(centres, k=3)[1]
    inside = (((centres[:, None] - ((a + b + c) / 3)[near]) * outward[near]).sum(2) < 0).all(1)
    places = member.verts[np.unique(head)]
    reach = _INSIDE_THE_HEAD * float(np.ptp(places, axis=0).min())
    labels[neck[inside | (cKDTree(places).query(centres)[0] < reach)]] = code("head")
    return labels
