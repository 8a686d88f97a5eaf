"""Parts of a body by its reading (`meshdeform.reading`) and by what people painted, each as faces, pieces and weights.

A part holds what belongs to it, as ears to a head, and carries what would fall off without it. Its weights are 0 where
it meets what stays and 1 deeper than `_BAND` of its size, so that the rest does not move and what it carries is not
torn off.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.plain.body import UP, Body, Flags, Floats, Index, step
from meshdeform.plain.carried import NEAR, carried_by, contacts, on_ground, touching
from meshdeform.plain.pieces import Limb, PartMissingError, Piece
from meshdeform.plain.vocabulary import PART_OF, singular
from meshdeform.plain.words import part_and_sides
from meshdeform.reading.cells import connected
from meshdeform.vocabulary.solids import CARRIED_BY, PART_NAMES, parts_of

__all__ = ["GIVEN", "READ", "TOLD_APART", "ReadParts"]

GIVEN, READ = "given", "shapes"
"""How a part was found: people said so, or the shapes of its noun."""
_HOLDS = frozenset({"head", "arm", "leg", "door", "tower", "turret", "sleeve"})
"""Parts to which those that they carry belong."""
_ALSO = {
    "nose": ("beak",), "beak": ("nose",), "hair": ("mane",), "crown": ("canopy", "leaf"), "tower": ("turret",),
    "fin": ("wing",), "exhaust": ("chimney",), "arm": ("wing",), "horn": ("tusk",),
}  # fmt: skip
"""Other names under which a noun has a part."""
TOLD_APART = frozenset({*PART_NAMES, *_ALSO})
"""The parts that readings can find."""
_BAND = 0.25
_INSIDE = 0.5
_LEAST_PIECE = 0.3
"""Extent of a piece of a part, as a share of that of its largest, at least."""
_LONG, _ROUND = 1.5, 1.15
"""How many times as long as high a piece of wheels is from which it is several, and the reach of each in radii."""
_FEW = 0.4
"""Share of a part's vertices that is far from its border, below which it has too few for a band."""
_APART = 0.4
"""Distance between points where a piece touches the rest, as a share of its extent, from which it hangs at both."""
_END = 0.35
"""Extent of such a contact, likewise, up to which it is an end: a cushion lies along what it touches."""
_HARDLY = 0.01
"""Share of a piece's vertices beside the rest, below which it only touches it."""
_UNREAD = -2


class ReadParts:
    """The parts that the reading of one body found."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self._painted: dict[str, Flags] = {}
        for name, faces in body.painted.items():
            part = _in_a_sentence(name)
            self._painted[part] = self._painted.get(part, np.zeros(len(body.faces), bool)) | faces
        self._renamed = {_in_a_sentence(old): _in_a_sentence(new) for old, new in body.renamed.items()}
        self.said = {_in_a_sentence(name): name.lower() for name in (*body.renamed.values(), *body.painted)}
        """What people called the parts that they told of, as they wrote it: `stilts` of a stilt."""
        self._limbs: dict[str, Limb] = {}

    def is_given(self, part: str) -> bool:
        """Return whether people said where a part is, or what it is called."""
        return part in self._painted or part in self._renamed.values()

    @property
    def noun(self) -> str:
        """What the body was taken for; empty if it was not read."""
        reading = self.body.reader.reading
        return "" if reading is None else reading.noun

    @property
    def is_sure(self) -> bool:
        """Whether the body was read, and the noun can be told without a question."""
        reading = self.body.reader.reading
        return reading is not None and reading.sure

    @cached_property
    def of_noun(self) -> frozenset[str]:
        """The parts that things of its noun have; empty if it was not read."""
        return parts_of(self.noun)

    @cached_property
    def _coded(self) -> tuple[Index, tuple[str, ...]]:
        """The number (F,) of the part of each face among names; negative without one."""
        body, reading = self.body, self.body.reader.reading
        names = list(PART_NAMES)
        codes = np.full(len(body.faces), _UNREAD, np.int64) if reading is None else reading.labels.copy()
        old = codes.copy()
        for found, called in self._renamed.items():
            if found in names:
                codes[old == names.index(found)] = _index_in(names, called)
        for called, faces in self._painted.items():
            codes[faces] = _index_in(names, called)
        return codes, tuple(names)

    @property
    def labels(self) -> Index:
        """The part of each face (F,): an index into `PART_NAMES`, `GROUND`, or `NO_PART`, also for names of no noun."""
        codes, _ = self._coded
        return np.where(codes < len(PART_NAMES), codes, _UNREAD)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of all its parts."""
        codes, names = self._coded
        return tuple(names[number] for number in np.unique(codes) if number >= 0)

    def confidence(self, part: str) -> float | None:
        """Return how likely a part is right, as the reading says; None if people told of it, or nothing was read."""
        reading = self.body.reader.reading
        if reading is None or part in self._painted:
            return None
        found = [old for old, new in self._renamed.items() if new == part] or list(self._called(part))
        shares = [reading.confidence[name] for name in found if name in reading.confidence]
        return min(shares, default=None)

    def found_by(self, part: str) -> str:
        """Return `GIVEN` of a part that people told of, else `READ`."""
        return GIVEN if self.is_given(part) else READ

    def faces(self, part: str) -> Flags:
        """Return the faces (F,) of a part with what belongs to it; none if it was not found."""
        codes, names = self._coded
        called = self._called(part)
        own = [number for number, name in enumerate(names) if self._belongs(name, called)]
        return np.isin(codes, own)

    def itself(self, part: str) -> Flags:
        """Return the faces (F,) of a part without what belongs to it."""
        codes, names = self._coded
        called = self._called(part)
        return np.isin(codes, [number for number, name in enumerate(names) if name in called])

    def by_another_name(self, part: str) -> bool:
        """Return whether a part was found under another name than its own."""
        return part in _ALSO and self._called(part) not in ((), (part,))

    def _called(self, part: str) -> tuple[str, ...]:
        """Return the names under which a part was found."""
        return (part,) if part in self.names else tuple(name for name in _ALSO.get(part, ()) if name in self.names)

    def _belongs(self, name: str, called: Sequence[str]) -> bool:
        while name not in called:
            above = CARRIED_BY.get(name)
            if above is None or above not in _HOLDS:
                return False
            name = above
        return True

    def has(self, part: str) -> bool:
        """Return whether a part was found, and is not all there is."""
        faces = self.faces(part)
        return bool(faces.any() and not faces.all())

    def share(self, faces: Flags) -> Floats:
        """Return the share (V,) of the area around each vertex that some faces (F,) have."""
        body, count = self.body, len(self.body.points)
        areas = np.maximum(np.linalg.norm(body.crosses, axis=1), 1e-300)
        total = np.bincount(body.faces.ravel(), np.repeat(areas, 3), count)
        own = np.bincount(body.faces.ravel(), np.repeat(areas * faces, 3), count)
        return np.asarray(own / np.maximum(total, 1e-300))

    def limb(self, part: str) -> Limb:
        """Return a part as its pieces.

        Raises PartMissingError: it was not found.
        """
        if part not in self._limbs:
            self._limbs[part] = self._limb(part)
        return self._limbs[part]

    def _limb(self, part: str) -> Limb:
        if not self.has(part):
            raise PartMissingError(self.missing(part))
        share = self.share(self.faces(part))
        pieces = [self._piece(part, rows, share) for rows in self._groups(part, share)]
        pieces = [piece for piece in pieces if len(piece.rows)]
        if not pieces:
            raise PartMissingError(self.missing(part))
        return Limb(self.body, pieces, self.found_by(part))

    def missing(self, part: str) -> str:
        """Return why there is no such part."""
        if not self.noun and not self._painted:
            return f"No {part} was found: nobody knows what the asset is, and its file names none."
        return f"No {part} was found." if not self.noun else f"No {part} was found: this was taken for a {self.noun}."

    def _groups(self, part: str, share: Floats) -> list[Index]:
        """Return the vertices of each piece, without crumbs."""
        inside = share > _INSIDE
        if not inside.any():
            inside = share >= share.max()
        groups = self.body.groups(inside)
        extents = np.array([float(np.ptp(self.body.points[rows], axis=0).max()) for rows in groups])
        groups = [rows for rows, extent in zip(groups, extents, strict=True) if extent >= _LEAST_PIECE * extents.max()]
        return [wheel for rows in groups for wheel in self._wheels(rows)] if part == "wheel" else groups

    def _wheels(self, rows: Index) -> list[Index]:
        """Return the wheels of a piece that is longer than high: those at its ends, without what joins them."""
        body = self.body
        own = body.points[rows]
        low, high = own.min(0), own.max(0)
        radius = float(high[UP] - low[UP]) / 2
        if high[body.front] - low[body.front] < _LONG * 2 * radius:
            return [rows]
        up = low[UP] + radius
        along = (low[body.front] + radius, high[body.front] - radius)
        apart = [np.hypot(own[:, UP] - up, own[:, body.front] - at) < _ROUND * radius for at in along]
        return [rows[flags] for flags in apart if flags.any()]

    def _piece(self, part: str, rows: Index, share: Floats) -> Piece:
        """Return a piece with its weights, the point where it hangs, and what it carries."""
        body, inside = self.body, np.zeros(len(share), bool)
        inside[rows] = True
        carried = carried_by(body, inside)
        stays = ~inside & ~np.logical_or.reduce([inside, *carried])
        hangs_at = touching(body, inside, stays)
        if self._is_loose(rows, stays):
            ends = contacts(body, rows, stays)
            hangs_at = ends if self._hangs_at_both_ends(rows, ends) else hangs_at
        own = np.where(self._near(inside), share, 0.0)
        weight = self._inner(own, rows, stays, hangs_at) if part != "wheel" else inside.astype(float)
        at = hangs_at.mean(0) if len(hangs_at) else body.points[rows].mean(0)
        if part == "wheel":
            at = (body.points[rows].max(0) + body.points[rows].min(0)) / 2
        elif not stays.any() or on_ground(body, rows):  # what stands grows from the ground
            at[UP] = body.points[rows, UP].min()
        return Piece(body, weight, at, carried=tuple(flags.astype(float) for flags in carried))

    def _is_loose(self, rows: Index, stays: Flags) -> bool:
        """Return whether a piece only touches the rest, as a handle may: it shares hardly an edge with it."""
        beside = (self.body.edges @ stays.astype(float)) > 0
        return bool(beside[rows].mean() < _HARDLY)

    def _near(self, inside: Flags) -> Flags:
        """Return a part's vertices (V,) and their neighbours."""
        return np.asarray(inside | ((self.body.edges @ inside.astype(float)) > 0))

    def _inner(self, share: Floats, rows: Index, stays: Flags, hangs_at: Floats) -> Floats:
        """Return the weights (V,) of a piece with shares (V,): 0 where it meets what stays, 1 away from there."""
        body = self.body
        border = (body.edges @ stays.astype(float)) > 0
        joined = np.isin(body.components, np.unique(body.components[rows[border[rows]]]))
        weight = np.where(share > _INSIDE, 1.0, 0.0)
        loose = not joined[rows].any()
        if loose and not self._hangs_at_both_ends(rows, hangs_at):
            return weight
        size = float(np.sqrt(np.square(body.points[rows] - body.points[rows].mean(0)).sum(1).mean()))
        distance = cKDTree(hangs_at).query(body.points[rows])[0] if len(hangs_at) else np.full(len(rows), np.inf)
        deep = step(distance / max(_BAND * size, 1e-300))
        banded = weight.copy()
        banded[rows] = np.where(border[rows], 0.0, np.where(joined[rows] | loose, deep, 1.0))
        if (banded[rows] > _INSIDE).sum() < _FEW * len(rows):  # too few vertices for a band
            return weight
        return banded

    def _hangs_at_both_ends(self, rows: Index, hangs_at: Floats) -> bool:
        """Return whether a piece of its own touches the rest at points far apart, as a handle does."""
        if len(hangs_at) < 2:
            return False
        reach = NEAR * self.body.diagonal
        near = cKDTree(hangs_at).query_pairs(4 * reach, output_type="ndarray")
        label = connected(len(hangs_at), near)
        if not label.any():
            return False
        extent = float(np.ptp(self.body.points[rows], axis=0).max())
        ends = [hangs_at[label == k] for k in range(label.max() + 1)]
        if max(float(np.ptp(end, axis=0).max()) for end in ends) > _END * extent:
            return False
        middles = np.array([end.mean(0) for end in ends])
        return float(np.ptp(middles, axis=0).max()) > _APART * extent


def _in_a_sentence(name: str) -> str:
    """Return the name of a part as sentences have it: "Left Antlers" are a horn."""
    words = [PART_OF.get(singular(word), singular(word)) for word in name.lower().replace("-", " ").split()]
    return part_and_sides(words)[1] or name.lower()


def _index_in(names: list[str], name: str) -> int:
    """Return the index of a name in a list, which gets it if it lacks it."""
    if name not in names:
        names.append(name)
    return names.index(name)
