"""Grade how near the members of a noun are to an asset.

The asset is turned so that its front is +Z and scaled so that the diagonal of its box is 1. A member is scaled to the
asset's box along each axis, by at most `EASE` against the mean of the three. With features f of samples (`samples`),
the grade is

    mean_i min_j |f_i - g_j| + 1/2 mean_j min(min_i |f_i - g_j|, 0.15) + 0.01 s,

i over the asset, j over the member, s the largest logarithm of a scale against the mean. All members are graded by
few samples, those that come out best by all.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.banks import MEMBERS, SAMPLES, Bank, Singles, bank_of, is_general
from meshdeform.reading.samples import NORMAL_WEIGHT, features, spread

__all__ = ["Candidate", "Frame", "candidates", "facing", "nearness"]

EASE = 1.5
_FEW = 220
_FINALISTS, _OWN_FINALISTS = 28, 8
_FAR = 0.15
_ENLARGED = 0.01


@dataclass(frozen=True)
class Frame:
    """The asset with its front toward +Z, its box about the origin with a diagonal of 1.

    `verts` (V, 3) float64, `faces` (F, 3) int64, `turn` (3, 3) float64 from the asset's axes, `low` and `high` (3,).
    """

    verts: Floats
    faces: Index
    turn: Floats
    low: Floats
    high: Floats

    @classmethod
    def turned(cls, verts: Floats, faces: Index, turn: Floats) -> Frame:
        """Turn a mesh by a rotation (3, 3), scale it and move it to the origin."""
        turned = verts @ turn.T
        used = turned[np.unique(faces)]
        low, high = used.min(0), used.max(0)
        diagonal = max(float(np.linalg.norm(high - low)), 1e-300)
        placed = (turned - (low + high) / 2) / diagonal
        return cls(placed, faces, turn, (low - high) / 2 / diagonal, (high - low) / 2 / diagonal)

    @cached_property
    def features(self) -> Singles:
        """Features (N, 6) float32 of samples of the surface; the first few are spread as all are."""
        own = spread(self.verts, self.faces, SAMPLES, 1)
        mixed = np.random.default_rng(6).permutation(SAMPLES)
        return features(own.places[mixed], own.normals[mixed]).astype(np.float32)


def facing(azimuth_deg: float) -> Floats:
    """Return the rotation (3, 3) that turns a front at an azimuth, counted from +Z toward +X, to +Z."""
    angle = -np.radians(azimuth_deg)
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


@dataclass(frozen=True)
class Candidate:
    """A drawn member and its grade: the number of the draw decides all of it."""

    noun: str
    number: int
    grade: float

    @property
    def general(self) -> bool:
        """Whether it is of a form that other nouns have as well."""
        return is_general(self.noun, self.number)


def box_scale(low: Floats, high: Floats, frame: Frame) -> tuple[Floats, float]:
    """Return the scales (3,) that take a box to the asset's, limited, and how far they would differ without."""
    each = (frame.high - frame.low) / np.maximum(high - low, 1e-9)
    each = np.maximum(each, 1e-9)
    mean = float(np.exp(np.log(each).mean()))
    return np.clip(each, mean / EASE, mean * EASE), float(np.abs(np.log(each / mean)).max())


def placed(points: Floats, low: Floats, high: Floats, scale: Floats, frame: Frame) -> Floats:
    """Return points of a member scaled and put on the asset's ground."""
    at = (points - (low + high) / 2) * scale
    at[..., 1] += frame.low[1] + (high[1] - low[1]) / 2 * scale[1]
    return at


def candidates(frame: Frame, noun: str, count: int, folder: Path | None = None) -> list[Candidate]:
    """Return the nearest members of a noun, the best first; `folder` keeps samples of them (`banks`)."""
    bank = bank_of(noun, folder)
    rough = _graded(frame, bank, noun, range(MEMBERS), _FEW)
    not_shared = [one for one in rough if not one.general]
    finalists = {one.number for one in [*rough[:_FINALISTS], *not_shared[:_OWN_FINALISTS]]}
    return _graded(frame, bank, noun, sorted(finalists), SAMPLES)[:count]


def nearness(frame: Frame, noun: str, folder: Path | None = None) -> tuple[float, float]:
    """Return the grades of the nearest member of a noun, and of those whose form no other noun has."""
    nearest = candidates(frame, noun, MEMBERS, folder)
    return nearest[0].grade, next((one.grade for one in nearest if not one.general), nearest[0].grade)


def _graded(frame: Frame, bank: Bank, noun: str, numbers: Iterable[int], samples: int) -> list[Candidate]:
    """Return some members with their grades by so many samples, the best first."""
    asset = frame.features[:samples]
    own = [Candidate(noun, number, _grade(frame, bank, number, asset)) for number in numbers]
    return sorted(own, key=lambda one: (one.grade, one.number))


def _grade(frame: Frame, bank: Bank, number: int, asset: Singles) -> float:
    """Return how far a member is from the asset's features (N, 6)."""
    low, high = bank.low[number].astype(float), bank.high[number].astype(float)
    scale, enlarged = box_scale(low, high, frame)
    few = len(asset)
    normals = bank.normals[number, :few] / scale.astype(np.float32)
    normals *= NORMAL_WEIGHT / np.maximum(np.sqrt(np.einsum("nk,nk->n", normals, normals)), 1e-12)[:, None]
    own = np.empty((few, 6), np.float32)
    own[:, :3], own[:, 3:] = placed(bank.places[number, :few], low, high, scale, frame), normals
    squares = own @ (-2 * asset.T)  # all pairs: quicker than a tree for so few
    squares += np.einsum("nk,nk->n", asset, asset)
    squares += np.einsum("nk,nk->n", own, own)[:, None]
    to_asset, to_member = (np.sqrt(np.maximum(squares.min(axis), 0)) for axis in (1, 0))
    return float(0.5 * np.minimum(to_asset, _FAR).mean() + to_member.mean() + _ENLARGED * enlarged)
