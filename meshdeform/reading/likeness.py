"""Tell what an asset may be by how its surface is spread: like which members of the nouns.

A description has, for each cell of a grid of 6 x 8 x 6 and each axis, the square root of the share of the area that
lies in the cell and faces along the axis, and beside these the sides of the box by its diagonal. The grid is laid over
a box halfway, in logarithms, between the asset's and a cube. Descriptions of members are in `members.npz`, by their
`KEPT` principal components, each divided by the square root of its spread within a noun; `python -m training.likeness`
writes it. With d the distance to the nearest member of a noun over all fronts, its probability is

    exp(-(d^2 - least d^2) / T), normalised.

A surface is found again by where it is and how it faces, as of a chair by its seat and its back, whatever the pieces
are of which it is made. Source of the square roots: Hellinger's distance of distributions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.cells import ground_plate
from meshdeform.reading.choice import AssetMesh, FrontFrame, facing
from meshdeform.reading.deciding import FRONTS, lying
from meshdeform.vocabulary.nouns import HELD

__all__ = ["KEPT", "MEMBERS_FILE", "Likeness", "described", "nouns_alike"]

MEMBERS_FILE = Path(__file__).with_name("members.npz")
KEPT = 128
_GRID = (6, 8, 6)
_TEMPERATURE = 0.25

Singles = NDArray[np.float32]


def described(positions: Floats, normals: Floats, low: Floats, high: Floats) -> Floats:
    """Return the description (D,) of what faces +Z: samples (N, 3) with their normals, and the bounds of its box."""
    size = np.maximum(high - low, 1e-9)
    sides = np.sqrt(size * size.max())
    at = ((positions - (low + high) / 2) / sides + 0.5).clip(0, 1) * _GRID - 0.5
    first = np.floor(at).astype(np.int64)
    share = at - first
    facing = np.square(normals) / np.maximum(np.square(normals).sum(1, keepdims=True), 1e-12) / len(positions)
    cells = np.zeros((int(np.prod(_GRID)), 3))
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, share, 1 - share).prod(1)
        cell = np.ravel_multi_index(tuple((first + corner).clip(0, np.array(_GRID) - 1).T), _GRID)
        for axis in range(3):
            cells[:, axis] += np.bincount(cell, weight * facing[:, axis], len(cells))
    return np.concatenate([np.sqrt(cells).ravel(), size / np.linalg.norm(size)])


@dataclass(frozen=True)
class Likeness:
    """Descriptions of M members, and what reduces a description to K numbers.

    `nouns`: N names, by the alphabet; `noun_of` (M,) int64: the noun of each member, whose members follow each other;
    `members` (M, K) float32; `mean` (D,) and `basis` (D, K) float32.
    """

    nouns: tuple[str, ...]
    noun_of: Index
    members: Singles
    mean: Singles
    basis: Singles

    @classmethod
    def read(cls, path: Path = MEMBERS_FILE) -> Likeness:
        """Return what a file holds."""
        with np.load(path, allow_pickle=False) as file:
            members = file["members"].astype(np.float32) * file["steps"]
            counts = file["counts"].astype(np.int64)
            noun_of = np.repeat(np.arange(len(counts)), counts)
            return cls(tuple(file["nouns"].tolist()), noun_of, members, file["mean"], file["basis"].astype(np.float32))

    def distances(self, descriptions: Sequence[Floats]) -> Floats:
        """Return the square (Q, N) of the distance of each description to the nearest member of each noun."""
        asked = (np.stack(descriptions).astype(np.float32) - self.mean) @ self.basis
        squares = np.square(asked).sum(1)[:, None] + np.square(self.members).sum(1) - 2 * asked @ self.members.T
        firsts = np.searchsorted(self.noun_of, np.arange(len(self.nouns)))
        return np.asarray(np.minimum.reduceat(squares, firsts, axis=1), np.float64)


def nouns_alike(verts: Floats, faces: Index) -> Mapping[str, float]:
    """Return the probability of each noun by what its members are like, of a mesh (V, 3), (F, 3) with +Y up.

    They sum to 1; which side is the front does not count. A plate under it is left out. Raises ValueError: it has no
    area.
    """
    surface = AssetMesh(verts, faces[~ground_plate(verts, faces)] if len(faces) else faces)
    if not float(surface.areas.sum()) > 0:
        raise ValueError("a mesh without area is like nothing")
    frames = [FrontFrame(surface, turn) for turn in (*map(facing, FRONTS), *lying(surface))]
    members = _members()
    held = np.array([noun in HELD for noun in members.nouns])
    each = members.distances([_of_frame(frame) for frame in frames])
    squares = np.where(held, each.min(0), each[: len(FRONTS)].min(0))
    likely = np.exp(-(squares - squares.min()) / _TEMPERATURE)
    return dict(zip(members.nouns, (likely / likely.sum()).tolist(), strict=True))


def _of_frame(frame: FrontFrame) -> Floats:
    positions, normals = np.split(frame.features.astype(float), 2, axis=1)
    return described(positions, normals, frame.low, frame.high)


@cache
def _members() -> Likeness:
    return Likeness.read()
