"""Draw members of a noun, and grade how near each is to an asset.

The asset is turned so that its front is +Z and scaled so that the diagonal of its box is 1. A member is scaled to the
asset's box along each axis, by at most `EASE` against the mean of the three. With features f of samples (`samples`),
the grade is

    mean_i min_j |f_i - g_j| + 1/2 mean_j min(min_i |f_i - g_j|, 0.15) + 0.01 s,

i over the asset, j over the member, s the largest logarithm of a scale against the mean. Half of the members have
random attributes of parts, two thirds of those that can stand otherwise are posed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.nouns.forms import FORMS, GENERAL, drawn
from meshdeform.nouns.labels import Floats, Index, LabelledMember
from meshdeform.nouns.poses import POSES, posed
from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.priors.builtin.vocabulary import NOUNS, PARTS
from meshdeform.reading.samples import NORMAL_WEIGHT, features, spread

__all__ = ["MEMBERS", "Candidate", "Frame", "candidate_member", "candidates"]

MEMBERS = 110
EASE = 1.5
_SAMPLES, _FEW = 700, 220
_FINALISTS, _OWN_FINALISTS = 28, 8
_FAR = 0.15
_ENLARGED = 0.01

Singles = NDArray[np.float32]


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
        return FORMS[self.noun][self.number % len(FORMS[self.noun])] in GENERAL


@dataclass(frozen=True)
class _Bank:
    """Samples of all members of a noun: places and normals (M, N, 3) float32, boxes (M, 3) float64."""

    places: Singles
    normals: Singles
    low: Floats
    high: Floats


def candidate_member(noun: str, number: int) -> LabelledMember:
    """Draw the member of a number, with attributes and a pose of its own."""
    forms = FORMS[noun]
    form, seed = forms[number % len(forms)], number // len(forms) + 1
    rng = np.random.default_rng([seed, 71])
    attributes = []
    if seed % 2:
        attributes = [
            Attribute(part, PARTS[part][int(rng.integers(2))]) for part in NOUNS.get(form, ()) if rng.random() < 0.5
        ]
    member = drawn(form, attributes, rng)
    poses = POSES.get(form, ())
    if seed % 3 == 0:
        for pose in ("walking", "turned"):
            member = posed(member, pose, rng) if pose in poses else member
    others = [pose for pose in poses if pose not in ("walking", "turned")]
    if seed % 3 == 1 and others:
        member = posed(member, others[int(rng.integers(len(others)))], rng)
    return member


@lru_cache(maxsize=24)
def _bank(noun: str) -> _Bank:
    """Draw all members of a noun, once."""
    members = [candidate_member(noun, number) for number in range(MEMBERS)]
    samples = [spread(member.verts, member.faces, _SAMPLES, 2) for member in members]
    mixed = np.random.default_rng(5).permutation(_SAMPLES)  # so that the first few are spread as all are
    return _Bank(
        np.stack([one.places[mixed] for one in samples]).astype(np.float32),
        np.stack([one.normals[mixed] for one in samples]).astype(np.float32),
        np.stack([member.verts.min(0) for member in members]),
        np.stack([member.verts.max(0) for member in members]),
    )


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


def candidates(frame: Frame, noun: str, count: int) -> list[Candidate]:
    """Return the nearest members of a noun, the best first."""
    bank = _bank(noun)
    own = spread(frame.verts, frame.faces, _SAMPLES, 1)
    mixed = np.random.default_rng(6).permutation(_SAMPLES)
    asset = features(own.places[mixed], own.normals[mixed])
    few = asset[:_FEW]
    rough = [Candidate(noun, number, _grade(frame, bank, number, few, None)) for number in range(MEMBERS)]
    rough.sort(key=lambda one: one.grade)
    not_shared = [one for one in rough if not one.general]
    finalists = {one.number for one in [*rough[:_FINALISTS], *not_shared[:_OWN_FINALISTS]]}
    tree = cKDTree(asset)
    fine = [Candidate(noun, number, _grade(frame, bank, number, asset, tree)) for number in sorted(finalists)]
    return sorted(fine, key=lambda one: (one.grade, one.number))[:count]


def nearness(frame: Frame, noun: str) -> tuple[float, float]:
    """Return the grades of the nearest member of a noun, and of those whose form no other noun has."""
    nearest = candidates(frame, noun, MEMBERS)
    return nearest[0].grade, next((one.grade for one in nearest if not one.general), nearest[0].grade)


def _grade(frame: Frame, bank: _Bank, number: int, asset: Floats, tree: cKDTree | None) -> float:
    """Return how far a member is from the asset's features (N, 6)."""
    low, high = bank.low[number], bank.high[number]
    scale, enlarged = box_scale(low, high, frame)
    few = len(asset)
    normals = bank.normals[number, :few] / scale
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    own = np.hstack([placed(bank.places[number, :few].astype(float), low, high, scale, frame), NORMAL_WEIGHT * normals])
    if tree is None:
        squares = (own**2).sum(1)[:, None] + (asset**2).sum(1)[None] - 2 * own @ asset.T
        to_asset, to_member = (np.sqrt(np.maximum(squares.min(axis), 0)) for axis in (1, 0))
    else:
        to_asset, to_member = tree.query(own)[0], cKDTree(own).query(asset)[0]
    return float(0.5 * np.minimum(to_asset, _FAR).mean() + to_member.mean() + _ENLARGED * enlarged)


def prepare(noun: str) -> None:
    """Draw the members of a noun, so that a later reading does not wait for it."""
    _bank(noun)
