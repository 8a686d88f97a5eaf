"""A part and its pieces: each of two ears, four wheels or ten fingers, with what hangs on it, its axes and its side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.plain.body import UP, Body, Flags, Floats, Index
from meshdeform.plain.names import sides_of

_INSIDE = 0.5
_FEWEST = 3
"""Vertices of a piece that has axes of its own."""
_SLENDER = 1.5
"""How many times as long as wide a piece is from which its own axis is told by its shape."""
_HANGS = 0.1
"""Distance of a piece's middle from where it is attached, as a share of its size, from which it hangs there."""
_ALONG = 0.5
"""Cosine between that axis and the way from where it hangs, above which the axis counts: a muzzle is also high."""
_NEARLY = 0.95
"""Cosine from which the axis of a stout piece counts as that of the asset beside it."""
_AT_AN_END = 0.2
"""Share of a piece's extent from an end, within which it is attached at that end."""
_BESIDE = 0.1
"""Distance from the middle of all pieces, as a share of how far they are apart, from which a piece is on a side."""
_OPPOSITE = {"left": "right", "right": "left", "front": "rear", "rear": "front"}
_ROW = 0.15
"""Distance between pieces that follow each other along an axis, as a share of how far all are apart, from which they
are in rows of their own."""


class PartMissingError(Exception):
    """A part that a word names is not there; the message says why."""


@dataclass(frozen=True)
class Piece:
    """One of the pieces of a part."""

    body: Body
    weight: Floats  # (V,) float64: how much each vertex belongs to it
    pivot: Floats  # (3,) float64: where it is attached; its middle if it hangs on nothing
    name: str = ""  # of its joint or node
    carried: tuple[Floats, ...] = ()  # (V,) float64 each: how much each vertex belongs to a chain that hangs on it

    @cached_property
    def rows(self) -> Index:
        """Its vertices."""
        return np.flatnonzero(self.weight > _INSIDE)

    @cached_property
    def axes(self) -> Floats:
        """Its own axes, as rows of (3, 3): its length first."""
        own = self.body.points[self.rows]
        if len(own) < _FEWEST:
            return np.eye(3)
        middle = own.mean(0)
        sides, spread = np.linalg.svd(own - middle, full_matrices=False)[1:]
        axis = middle - self.pivot
        reach = float(np.linalg.norm(axis))
        hangs = reach >= _HANGS * np.linalg.norm(np.ptp(own, axis=0))
        slender = sides[0] > _SLENDER * sides[1] and (not hangs or abs(spread[0] @ axis) > _ALONG * reach)
        if slender or not hangs:
            axis = spread[0] if slender else self._level_axis(own)
        axis = axis / max(float(np.linalg.norm(axis)), 1e-12)
        if not slender and np.abs(axis).max() > _NEARLY:
            axis = np.round(axis)
        across = np.eye(3)[int(np.argmin(np.abs(axis)))]
        second = np.cross(axis, across)
        second /= np.linalg.norm(second)
        return np.stack([axis, second, np.cross(axis, second)])

    def _level_axis(self, own: Floats) -> Floats:
        """Return the front axis for what lies, such as a bonnet, and the axis that it is longest along else."""
        size = np.ptp(own, axis=0)
        lies = size[UP] < min(size[self.body.front], size[self.body.lateral])
        return np.asarray(np.eye(3)[self.body.front if lies else int(np.argmax(size))])

    def anchor(self, axis: Floats) -> Floats:
        """Return a point (3,) that stays when it grows along an axis (3,): an end that is attached, or its middle."""
        own = self.body.points[self.rows]
        along = own @ axis
        low, high = float(along.min()), float(along.max())
        at = (float(self.pivot @ axis) - low) / max(high - low, 1e-12)
        stays = low if at < _AT_AN_END else high if at > 1 - _AT_AN_END else (low + high) / 2
        return np.asarray(axis * stays)


@dataclass(frozen=True)
class Limb:
    """A part of an asset, as the pieces that it consists of: each leg, each wheel."""

    body: Body
    pieces: Sequence[Piece]
    found_by: str  # `given`, `joints`, `names` or `shapes`

    @cached_property
    def weight(self) -> Floats:
        """How much each vertex (V,) belongs to it."""
        total = np.zeros(len(self.body.points))
        for piece in self.pieces:
            total = total + piece.weight
        return np.asarray(np.clip(total, 0, 1))

    def on(self, sides: Sequence[str], forward: int, part: str) -> Limb:
        """Return the pieces on some sides; by their names, where these tell, else by where they are.

        `forward`: the sign of the front on its axis. Raises PartMissingError: none is there.
        """
        pieces = list(self.pieces)
        for side in (each for each in sides if each != "middle"):
            names = [sides_of(piece.name) for piece in self.pieces]
            told = any(side in each or _OPPOSITE.get(side) in each for each in names)
            pieces = [
                piece
                for piece in pieces
                if (side in sides_of(piece.name) if told else self._is_there(piece, side, forward))
            ]
        pieces = self._in_middle(pieces) if "middle" in sides else pieces
        if not pieces:
            raise PartMissingError(f"No {' '.join(sides)} {part} was found, only {part}s without sides.")
        return replace(self, pieces=pieces)

    def _in_middle(self, pieces: list[Piece]) -> list[Piece]:
        """Return the pieces that are in no outer row, along the axis from front to back, else upward, else sideways."""
        body = self.body
        for axis in (body.front, UP, body.lateral):
            middles = np.array([body.points[each.rows].mean(0)[axis] for each in self.pieces])
            order = np.sort(middles)
            ends = order[:-1][np.diff(order) > _ROW * max(float(np.ptp(order)), 1e-300)]
            if len(ends) > 1:
                inner = {id(each) for each, at in zip(self.pieces, middles, strict=True) if ends[0] < at <= ends[-1]}
                return [each for each in pieces if id(each) in inner]
        return []

    def _is_there(self, piece: Piece, side: str, forward: int) -> bool:
        """Return whether a piece is on a side of the middle of all."""
        body = self.body
        axis = body.front if side in ("front", "rear") else UP if side in ("upper", "lower") else body.lateral
        middles = np.array([body.points[each.rows].mean(0)[axis] for each in self.pieces])
        apart = float(np.ptp(middles))
        middle = float(middles.min() + apart / 2) if axis != body.lateral else body.middle
        # What is left of something that looks along +Z is at +X, and of something that looks along +X at -Z.
        leftward = forward if axis == 0 else -forward
        level = {"front": forward, "rear": -forward, "left": leftward, "right": -leftward}
        towards = {**level, "upper": 1, "lower": -1}[side]
        least = _BESIDE * (apart if axis != body.lateral else float(body.size[axis]) / 2)
        return bool(towards * (body.points[piece.rows].mean(0)[axis] - middle) > max(least, 1e-9))


def attachment(body: Body, weight: Floats) -> Floats:
    """Return where a part is attached: the middle of its vertices beside the rest, by edges, else by nearness."""
    inside = weight > _INSIDE
    if not inside.any():
        inside = weight >= weight.max()
    beside: Flags = inside & ((body.edges @ (~inside).astype(float)) > 0)
    if not beside.any() and (~inside).any():
        distance = cKDTree(body.points[~inside]).query(body.points[inside])[0]
        near = distance <= distance.min() + 0.02 * body.diagonal
        beside = np.zeros(len(inside), bool)
        beside[np.flatnonzero(inside)[near]] = True
    return np.asarray(body.points[beside if beside.any() else inside].mean(0))
