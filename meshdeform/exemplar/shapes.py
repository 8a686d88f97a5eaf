"""What a fit starts from and what it gives: a surface with parts, what it is to become, and what came of it.

Everything lies in the frame of the asset: +Y up, its front toward +Z, its box about the origin with a diagonal of 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.result import Reading
from meshdeform.vocabulary.grammar import Borrowed
from meshdeform.vocabulary.lookup import Attribute

__all__ = ["ExemplarResult", "FitFrame", "Shape", "Wish"]


@dataclass(frozen=True)
class FitFrame:
    """The way from an asset's coordinates to those in which it is fitted, and back.

    `turn` (3, 3) float64 is a rotation; a point x goes to (turn x - middle) / diagonal.
    """

    turn: Floats
    middle: Floats
    diagonal: float

    @classmethod
    def around(cls, verts: Floats, faces: Index, turn: Floats) -> FitFrame:
        """Return the frame of the box of what faces (F, 3) use of vertices (V, 3)."""
        used = np.zeros(len(verts), bool)
        used[faces] = True
        turned = verts[used] @ turn.T
        low, high = turned.min(0), turned.max(0)
        return cls(turn, (low + high) / 2, max(float(np.linalg.norm(high - low)), 1e-300))

    def enter(self, points: Floats) -> Floats:
        """Return points (N, 3) of the asset in the frame."""
        return np.asarray((points @ self.turn.T - self.middle) / self.diagonal)

    def leave(self, points: Floats) -> Floats:
        """Return points (N, 3) of the frame in the asset's coordinates."""
        return np.asarray((points * self.diagonal + self.middle) @ self.turn)


@dataclass(frozen=True)
class Shape:
    """A surface with the part of each face.

    `verts` (V, 3) float64 in the frame, `faces` (F, 3) int64; `labels` (F,) int64: an index in `solids.PART_NAMES`,
    or `reading.GROUND` or `reading.NO_PART`; `noun`: what it is, empty if nobody knows; `solids` (F,) int64: the closed
    solid of each face, for a member of a noun, which is made of them.
    """

    noun: str
    verts: Floats
    faces: Index
    labels: Index
    solids: Index | None = None

    def moved(self, verts: Floats) -> Shape:
        """Return the shape with its vertices elsewhere."""
        return Shape(self.noun, verts, self.faces, self.labels, self.solids)


@dataclass(frozen=True)
class Wish:
    """What an asset is to become: a noun with attributes, or a given surface.

    `targets`: surfaces placed in the frame (`targets.placed`), of which the nearest is taken; without any, a member of
    `noun` is. `borrowed`: parts that it is to have of other nouns.
    `strength`: how much of the way is gone, from 0 to 1. `landmarks`: points (L, 3) of the asset and their goals,
    both in the frame.
    """

    noun: str = ""
    attributes: tuple[Attribute, ...] = ()
    targets: tuple[Shape, ...] = ()
    strength: float = 1.0
    seed: int = 0
    landmarks: tuple[Floats, Floats] | None = None
    borrowed: tuple[Borrowed, ...] = ()


@dataclass(frozen=True)
class ExemplarResult:
    """Where a fit has taken an asset, and how.

    `verts` (V, 3) float64 in the frame; `member`: what tells the exemplar again (its noun, form, number, attributes, or
    the index of a target); `distance_before` and `distance`: mean distance between asset and exemplar, a share of the
    diagonal, at the start and at the end; `pairs`: parts of the asset and of the exemplar that went to each other;
    `left_over` and `missing`: parts that only the asset, only the exemplar has; `kept`: share of the fitted
    displacement that was left when folds and cuts were mended; `flipped` and `cut`: faces newly turned over and newly
    cutting others; `stretch`: mean absolute logarithm of the stretches of the surface.
    """

    verts: Floats
    member: Mapping[str, object]
    distance_before: float
    distance: float
    pairs: Sequence[tuple[str, str]] = ()
    left_over: Sequence[str] = ()
    missing: Sequence[str] = ()
    kept: float = 1.0
    flipped: int = 0
    cut: int = 0
    stretch: float = 0.0


def frame_of(verts: Floats, faces: Index, reading: Reading | None) -> FitFrame:
    """Return the frame of an asset by what was read of it; as it lies where nothing was."""
    return FitFrame.around(verts, faces, np.eye(3) if reading is None else reading.turn)
