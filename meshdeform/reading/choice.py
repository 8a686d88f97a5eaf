"""Grade how near the members of a noun are to an asset.

The asset is turned so that its front is +Z and scaled so that the diagonal of its box is 1. A member is scaled to the
asset's box along each axis, by at most `EASE` against the mean of the three. With features f of samples (`samples`),
the grade is

    mean_i min_j |f_i - g_j| + 1/2 mean_j min(min_i |f_i - g_j|, 0.15) + 0.01 s,

i over the asset, j over the member, s the largest logarithm of a scale against the mean. All members are graded by
few samples, those that come out best by all.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.banks import SAMPLES, Bank, Singles, bank_of, is_general, members_with_parts
from meshdeform.reading.samples import NORMAL_WEIGHT, Samples, area_vectors, features, spread

__all__ = ["AssetMesh", "Candidate", "FrontFrame", "candidates", "facing", "nearness"]

EASE = 1.5
_FEW = 220
_FINALISTS, _OWN_FINALISTS = 28, 8
_FAR = 0.15
_ENLARGED = 0.01


class AssetMesh:
    """An asset of any position, size and turn: `verts` (V, 3) float64 and `faces` (F, 3) int64, at least one."""

    def __init__(self, verts: Floats, faces: Index) -> None:
        self.verts, self.faces = verts, faces

    @cached_property
    def used(self) -> Floats:
        """The points (U, 3) of the vertices that faces use."""
        used = np.zeros(len(self.verts), bool)
        used[self.faces] = True
        return self.verts[used]

    @cached_property
    def areas(self) -> Floats:
        """The areas (F,) of the faces."""
        return np.asarray(np.linalg.norm(area_vectors(self.verts, self.faces), axis=1) / 2)

    @cached_property
    def samples(self) -> Samples:
        """Places on the surface; the first few are spread as all are."""
        mixed = np.random.default_rng(6).permutation(SAMPLES)
        return spread(self.verts, self.faces, SAMPLES, 1).rows(mixed)


class FrontFrame:
    """An asset with its front toward +Z, its box about the origin with a diagonal of 1.

    `turn` (3, 3) float64 is the rotation from the asset's axes; `low` and `high` (3,) bound the box.
    """

    def __init__(self, surface: AssetMesh, turn: Floats) -> None:
        self.surface, self.turn, self.faces = surface, turn, surface.faces
        used = surface.used @ turn.T
        low, high = used.min(0), used.max(0)
        self._middle, self._diagonal = (low + high) / 2, max(float(np.linalg.norm(high - low)), 1e-300)
        self.low, self.high = (low - high) / 2 / self._diagonal, (high - low) / 2 / self._diagonal

    def _entered(self, points: Floats) -> Floats:
        return np.asarray((points @ self.turn.T - self._middle) / self._diagonal)

    @cached_property
    def verts(self) -> Floats:
        """The vertices (V, 3) float64."""
        return self._entered(self.surface.verts)

    @cached_property
    def features(self) -> Singles:
        """Features (N, 6) float32 of samples of the surface."""
        samples = self.surface.samples
        return features(self._entered(samples.positions), samples.normals @ self.turn.T).astype(np.float32)


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


def box_scale(low: Floats, high: Floats, frame: FrontFrame) -> tuple[Floats, float]:
    """Return the scales (3,) that take a box to the asset's, limited, and how far they would differ without."""
    each = (frame.high - frame.low) / np.maximum(high - low, 1e-9)
    each = np.maximum(each, 1e-9)
    mean = float(np.exp(np.log(each).mean()))
    return np.clip(each, mean / EASE, mean * EASE), float(np.abs(np.log(each / mean)).max())


def placed(points: Floats, low: Floats, high: Floats, scale: Floats, frame: FrontFrame) -> Floats:
    """Return points of a member scaled and put on the asset's ground."""
    at = (points - (low + high) / 2) * scale
    at[..., 1] += frame.low[1] + (high[1] - low[1]) / 2 * scale[1]
    return at


def candidates(frame: FrontFrame, noun: str, count: int, folder: Path | None = None) -> list[Candidate]:
    """Return the nearest members of a noun that have its parts, the best first; `folder` keeps samples (`banks`)."""
    bank = bank_of(noun, folder)
    rough = _graded(frame, bank, noun, range(members_with_parts(noun)), _FEW)
    return _refined(frame, bank, noun, rough, _FINALISTS)[:count]


def nearness(
    frames: Sequence[FrontFrame], noun: str, dearer: Sequence[float], folder: Path | None = None
) -> list[tuple[int, float, float]]:
    """Return, for the two frames in which members of a noun are nearest, their index in `frames` and two grades.

    They are the grades of the nearest member, and of the nearest whose form no other noun has; `dearer`: what the
    grades of each frame are multiplied by when the two are chosen.
    """
    bank = bank_of(noun, folder)
    rough = [_graded(frame, bank, noun, range(len(bank)), _FEW) for frame in frames]
    best = sorted(range(len(frames)), key=lambda k: rough[k][0].grade * dearer[k])[:2]
    fine = [(k, _refined(frames[k], bank, noun, rough[k], _FINALISTS // 2)) for k in best]
    return [(k, own[0].grade, next((one.grade for one in own if not one.general), own[0].grade)) for k, own in fine]


def _refined(frame: FrontFrame, bank: Bank, noun: str, rough: Sequence[Candidate], finalists: int) -> list[Candidate]:
    """Return the best of some graded members, graded by all samples."""
    not_shared = [one for one in rough if not one.general]
    numbers = {one.number for one in [*rough[:finalists], *not_shared[:_OWN_FINALISTS]]}
    return _graded(frame, bank, noun, sorted(numbers), SAMPLES)


def _graded(frame: FrontFrame, bank: Bank, noun: str, numbers: Iterable[int], samples: int) -> list[Candidate]:
    """Return some members with their grades by so many samples, the best first."""
    asset = frame.features[:samples]
    own = [Candidate(noun, number, _grade(frame, bank, number, asset)) for number in numbers]
    return sorted(own, key=lambda one: (one.grade, one.number))


def _grade(frame: FrontFrame, bank: Bank, number: int, asset: Singles) -> float:
    """Return how far a member is from the asset's features (N, 6)."""
    low, high = bank.low[number].astype(float), bank.high[number].astype(float)
    scale, enlarged = box_scale(low, high, frame)
    few = len(asset)
    normals = bank.normals[number, :few] / scale.astype(np.float32)
    normals *= NORMAL_WEIGHT / np.maximum(np.sqrt(np.einsum("nk,nk->n", normals, normals)), 1e-12)[:, None]
    own = np.empty((few, 6), np.float32)
    own[:, :3], own[:, 3:] = placed(bank.positions[number, :few].astype(float), low, high, scale, frame), normals
    squares = own @ (-2 * asset.T)  # all pairs: quicker than a tree for so few
    squares += np.einsum("nk,nk->n", asset, asset)
    squares += np.einsum("nk,nk->n", own, own)[:, None]
    to_asset, to_member = (np.sqrt(np.maximum(squares.min(axis), 0)) for axis in (1, 0))
    return float(0.5 * np.minimum(to_asset, _FAR).mean() + to_member.mean() + _ENLARGED * enlarged)
