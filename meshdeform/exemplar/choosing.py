"""Choose the members of a noun that an asset is to be fitted to: near to it in posture, in parts and in shape.

All members that have the wished attributes are graded by tables of samples (`reading.banks`):

    merit = d + 0.3 p + q,    d = mean_i min_j |f_i - g_j| + 1/2 mean_j min(min_i |f_i - g_j|, 0.15),

with features f of the asset's samples and g of the member's (`reading.samples`), scaled to the asset's box; p tells how
differently they hold their limbs (`posture`), and q which parts only one has: 0.025 of the sum of |s_k - t_k| for the
shares s, t of the surfaces that are of part k, 0.15 of the share of limbs without a partner, and 0.05 if one that
shows no legs is to sit or to lie. Those that come out best are drawn, take the asset's posture, are placed and graded
once more.

A member is scaled to the box by the geometric mean of the ratios of its sides, and each side by at most 1.15 against
it; not at all where the noun is built or an attribute is of the whole: proportions are what they are known by. It
stands on the asset's ground with its mirror plane at x = 0. Where nobody knows which way the asset faces, another
quarter turn is taken if it is 13 % nearer.

A lump, of which no member is near, becomes the nearest of the noun's own family in its plain pose.

Seeds other than 0 take others that are still near and unlike each other: the near ones are divided among centres, each
the one farthest from the centres before it (Gonzalez 1985, Clustering to minimize the maximum intercluster distance),
and a seed takes those of one centre. Of a word of somebody's own with few shapes, each seed takes one, the nearest
first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.exemplar.clay import is_clay
from meshdeform.exemplar.kinds import is_built, is_living, is_turned
from meshdeform.exemplar.pieces import pieces_of
from meshdeform.exemplar.posture import Posture, held_like, postures, unlikeness
from meshdeform.exemplar.shapes import Shape, Wish
from meshdeform.nouns.labels import Floats, Index, LabelledMember
from meshdeform.nouns.limbs import LIMB_OF_PART, LIMBS, NO_LIMB, limb_codes, limb_of
from meshdeform.reading.banks import SAMPLES, Bank, Singles, bank_of, candidate_member, form_of, pose_of
from meshdeform.reading.choice import facing
from meshdeform.reading.result import GROUND
from meshdeform.reading.samples import NORMAL_WEIGHT, Samples, features, spread
from meshdeform.support.giving_way import give_way
from meshdeform.support.recent import Recent
from meshdeform.vocabulary.nouns import AFLOAT
from meshdeform.vocabulary.solids import PART_NAMES
from meshdeform.words.in_use import like_of, own_word

__all__ = ["Compared", "Exemplar", "exemplars", "nearest_of"]

_EASE = 1.15
_FEW, _DENSE = 220, 2500
"""Samples by which all members are graded, and those of the other surface for the ones that are drawn."""
_FINALISTS, _SKETCHED = 12, 4
_FAR = 0.15
_POSTURE, _SHARES, _LONE, _UNSEEN = 0.3, 0.05, 0.15, 0.05
_OF_LEGS = ("sitting", "lying")
_QUARTERS, _TURNED_IF = (0.0, 90.0, 180.0, -90.0), 1.13
_STILL_NEAR, _LEAST_NEAR, _MOST_NEAR = 1.25, 10, 40
"""Ratio to the best merit up to which members are near; how many are at least, and at most."""
_CENTRES = 8
_CHOOSERS, _DRAWN = 2, 64
"""Wishes of an asset, and drawn members of a wish, that are kept for other seeds."""


@dataclass(frozen=True)
class Exemplar:
    """A member of a noun, placed on an asset and in its posture.

    `shape` in the asset's frame; `distance`: the d of the equation above; `merit`: the whole, by which it was chosen;
    `told` names it: noun, form, pose, number of the draw, attributes, and the quarter turn that it was given.
    """

    shape: Shape
    distance: float
    merit: float
    told: Mapping[str, object] = field(default_factory=dict)


class Compared:
    """An asset as members are compared with it."""

    def __init__(self, source: Shape) -> None:
        standing = source.labels != GROUND
        self.shape = Shape(source.noun, source.verts, source.faces[standing], source.labels[standing])
        corners = self.shape.verts[self.shape.faces].reshape(-1, 3)
        self.low, self.high = corners.min(0), corners.max(0)
        mixed = np.random.default_rng(6).permutation(SAMPLES)
        self.samples = spread(self.shape.verts, self.shape.faces, SAMPLES, 1).rows(mixed)
        self.features = features(self.samples.positions, self.samples.normals).astype(np.float32)
        self.dense = _dense(self.shape.verts, self.shape.faces, 3)
        labels = self.shape.labels[self.samples.faces]
        self.shares = _shares(labels[labels >= 0])
        self._choosers: Recent[_Chooser] = Recent(_CHOOSERS)

    def chooser(self, wish: Wish, cache: Path | None) -> _Chooser:
        """Return the members of a wish beside the asset, which all seeds share."""
        word = own_word(wish.noun)
        key = wish.noun, wish.attributes, None if word is None else word.sha256, cache
        chooser = self._choosers.get(key)
        if chooser is None:
            chooser = _Chooser(self, wish, cache)
            self._choosers.put(key, chooser)
        return chooser

    @property
    def has_parts(self) -> bool:
        """Whether any part of it is known."""
        return bool((self.shape.labels >= 0).any())

    @cached_property
    def posture(self) -> Posture:
        """How it holds its limbs."""
        names = {PART_NAMES[k]: LIMBS[LIMB_OF_PART[k]] for k in range(len(PART_NAMES)) if LIMB_OF_PART[k] >= 0}
        pieces = pieces_of(self.shape, names)
        numbers = [pieces.names[:k].count(name) for k, name in enumerate(pieces.names)]
        codes = [limb_of(LIMBS.index(name), number) for name, number in zip(pieces.names, numbers, strict=True)]
        limbs = np.array([*codes, NO_LIMB])[pieces.of_face][self.samples.faces]
        return postures(self.samples.positions[None], limbs[None], self.low[None], self.high[None])[0]


def _shares(labels: Index) -> Floats:
    """Return the share (P,) of each part among labels."""
    return np.asarray(np.bincount(labels, minlength=len(PART_NAMES)) / max(len(labels), 1))


@dataclass(frozen=True)
class _Graded:
    """A member, the quarter turn that it is given, and how it was graded."""

    number: int
    turn_deg: float
    distance: float
    merit: float


def exemplars(
    source: Shape, wish: Wish, count: int, *, cache: Path | None = None, compared: Compared | None = None
) -> list[Exemplar]:
    """Return the members of the wished noun to which an asset is fitted best, the best first.

    Parameters
    ----------
    source : Shape
        The asset in its frame.
    wish : Wish
        Its noun, attributes and seed count.
    count : int
        How many there are to be, at most.
    cache : Path, optional
        A folder in which tables of members are kept (`reading.banks`).
    compared : Compared, optional
        That of the source, which keeps what it has found of a wish for other seeds.
    """
    chooser = (compared or Compared(source)).chooser(wish, cache)
    if chooser.few:
        return chooser.drawn([chooser.few[wish.seed % len(chooser.few)]])
    graded = [one for one in chooser.graded if chooser.is_plain(one.number)] if is_clay(source) else chooser.graded
    nearest = chooser.drawn(graded[: max(_FINALISTS, 2 * count)])[:count]
    if wish.seed == 0:
        return nearest
    return chooser.drawn(chooser.cell({one.told["number"] for one in nearest}, wish.seed)[:count])


def nearest_of(source: Shape, noun: str) -> Exemplar:
    """Return the nearest of a few members of a noun, drawn without a table: to tell how near the noun is at all."""
    some = range(_SKETCHED)
    chooser = _Chooser(Compared(source), Wish(noun))
    return chooser.drawn(_Graded(number, 0.0, 0.0, 0.0) for number in some)[0]


class _Chooser:
    """The members of a wish, beside an asset."""

    def __init__(self, asset: Compared, wish: Wish, cache: Path | None = None) -> None:
        self._asset, self._wish, self._cache = asset, wish, cache
        whole = any(attribute.part == "whole" for attribute in wish.attributes)
        self._ease = 1.0 if is_built(wish.noun) or whole else _EASE
        self._afloat = like_of(wish.noun) in AFLOAT
        self._drawn_before: Recent[Exemplar] = Recent(_DRAWN)

    @cached_property
    def _bank(self) -> Bank:
        return bank_of(self._wish.noun, self._cache, self._wish.attributes)

    @cached_property
    def few(self) -> list[_Graded]:
        """All members, each as it is nearest, the best first, where there are few: seeds take them in turn."""
        if len(self._bank) >= _LEAST_NEAR:
            return []
        nearest: dict[int, _Graded] = {}
        for one in self.graded:
            nearest.setdefault(one.number, one)
        return list(nearest.values())

    def cell(self, taken: Set[object], seed: int) -> list[_Graded]:
        """Return the members that a seed other than 0 takes, none of those that 0 does."""
        others = [one for one in self.graded if one.number not in taken]
        near = sum(one.merit <= _STILL_NEAR * self.graded[0].merit for one in others)
        cells = self._cells(others[: int(np.clip(near, _LEAST_NEAR, _MOST_NEAR))])
        rounds, number = divmod(seed - 1, len(cells))
        first = rounds % len(cells[number])
        return cells[number][first:] + cells[number][:first]

    @cached_property
    def graded(self) -> list[_Graded]:
        """All members by the tables, the best first."""
        asset, bank = self._asset, self._bank
        turns = (0.0,) if asset.has_parts or is_turned(self._wish.noun) else _QUARTERS
        other = self._unlikeness_of_all()
        result = []
        for turn_deg in turns:
            for number in range(len(bank)):
                distance = _distance(self._features_of(number, turn_deg), asset.features[:_FEW])
                merit = distance * self._turn_factor(turn_deg) + float(other[number])
                result.append(_Graded(number, turn_deg, distance, merit))
        return sorted(result, key=lambda one: (one.merit, one.number, one.turn_deg))

    def is_plain(self, number: int) -> bool:
        """Return whether a member is of the noun's own family, in the pose in which that draws it."""
        noun, attributes = self._wish.noun, self._wish.attributes
        return form_of(noun, number, attributes) == noun and not self._pose(number)

    def _unlikeness_of_all(self) -> Floats:
        """Return what posture and parts add to the merit of each member (M,)."""
        bank = self._bank
        if not self._asset.has_parts:
            return np.zeros(len(bank))
        held = postures(bank.positions, bank.limbs, bank.low, bank.high)
        shares = [_shares(labels) for labels in bank.labels.astype(np.int64)]
        return np.array([self._unlikeness(k, held[k], shares[k]) for k in range(len(bank))])

    def _unlikeness(self, number: int, held: Posture, shares: Floats) -> float:
        own = self._asset.posture
        differing = float(np.abs(shares - self._asset.shares).sum()) / 2
        numbers = [np.bincount(one.kinds, minlength=len(LIMBS)) for one in (own, held)]
        lone = float(np.abs(numbers[0] - numbers[1]).sum()) / max(len(own.kinds) + len(held.kinds), 1)
        living = is_living(self._asset.shape.noun) and is_living(self._wish.noun)
        held_unlike = unlikeness(own, held) if living else 0.0
        unseen = LIMBS.index("leg") not in own.kinds and self._pose(number) in _OF_LEGS
        return _POSTURE * held_unlike + _SHARES * differing + _LONE * lone + _UNSEEN * unseen

    @staticmethod
    def _turn_factor(turn_deg: float) -> float:
        return 1.0 if turn_deg == 0 else _TURNED_IF

    def _pose(self, number: int) -> str:
        return pose_of(self._wish.noun, number, self._wish.attributes)

    def _features_of(self, number: int, turn_deg: float) -> Singles:
        """Return features (N, 6) of the first samples of a member, placed on the asset."""
        bank, turn = self._bank, facing(-turn_deg)
        corners = np.array([bank.low[number], bank.high[number]], float) @ turn.T
        low, high = corners.min(0), corners.max(0)
        scale = self._scale(low, high)
        positions = self._placed(bank.positions[number, :_FEW].astype(float) @ turn.T, low, high, scale)
        normals = bank.normals[number, :_FEW] @ turn.T / scale
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        return np.hstack([positions, NORMAL_WEIGHT * normals]).astype(np.float32)

    def _scale(self, low: Floats, high: Floats) -> Floats:
        """Return the scales (3,) that take a box to the asset's."""
        each = np.maximum(self._asset.high - self._asset.low, 1e-9) / np.maximum(high - low, 1e-9)
        mean = float(np.exp(np.log(each).mean()))
        return np.asarray(np.clip(each, mean / self._ease, mean * self._ease))

    def _placed(self, points: Floats, low: Floats, high: Floats, scale: Floats) -> Floats:
        """Return points of a member, of whose box the bounds are, scaled and put on the asset's ground."""
        asset = self._asset
        at = (points - (low + high) / 2 * [0, 1, 1]) * scale
        at += (asset.low + asset.high) / 2 * [0, 1, 1]
        if not self._afloat:
            at[:, 1] += (high[1] - low[1]) / 2 * scale[1] - (asset.high[1] - asset.low[1]) / 2
        return np.asarray(at)

    def drawn(self, members: Iterable[_Graded]) -> list[Exemplar]:
        """Return members as they are drawn, the best first."""
        return sorted((self._drawn(one) for one in members), key=lambda one: (one.merit, str(one.told)))

    def _drawn(self, graded: _Graded) -> Exemplar:
        key = graded.number, graded.turn_deg
        exemplar = self._drawn_before.get(key)
        if exemplar is None:
            exemplar = self._draw(graded)
            self._drawn_before.put(key, exemplar)
        return exemplar

    def _draw(self, graded: _Graded) -> Exemplar:
        """Draw a member, give it the asset's posture, put it on the asset's ground and grade it."""
        give_way()
        wish, asset = self._wish, self._asset
        member = candidate_member(wish.noun, graded.number, wish.attributes)
        if asset.has_parts and is_living(asset.shape.noun):
            member = held_like(member, asset.posture)
        turned = member.verts @ facing(-graded.turn_deg).T
        low, high = turned.min(0), turned.max(0)
        member = member.moved(self._placed(turned, low, high, self._scale(low, high)))
        samples = spread(member.verts, member.faces, SAMPLES, 2)
        own = features(samples.positions, samples.normals)
        to_asset = asset.dense.query(own)[0]
        to_member = _dense(member.verts, member.faces, 4).query(asset.features)[0]
        distance = float(0.5 * np.minimum(to_asset, _FAR).mean() + to_member.mean())
        merit = distance * self._turn_factor(graded.turn_deg)
        merit += self._unlikeness_drawn(graded.number, member, samples) if asset.has_parts else 0.0
        told = {
            "noun": wish.noun,
            "form": form_of(wish.noun, graded.number, wish.attributes),
            "pose": self._pose(graded.number),
            "number": graded.number,
            "attributes": [str(each) for each in wish.attributes],
            "turn_deg": graded.turn_deg,
        }
        shape = Shape(wish.noun, member.verts, member.faces, member.labels, member.solid_of_face)
        return Exemplar(shape, distance, merit, told)

    def _unlikeness_drawn(self, number: int, member: LabelledMember, samples: Samples) -> float:
        limbs = limb_codes(member)[samples.faces]
        low, high = member.verts.min(0), member.verts.max(0)
        held = postures(samples.positions[None], limbs[None], low[None], high[None])[0]
        return self._unlikeness(number, held, _shares(member.labels[samples.faces]))

    def _cells(self, near: Sequence[_Graded]) -> list[list[_Graded]]:
        """Divide members among centres that are unlike each other; each cell has its best first."""
        tables = [self._features_of(one.number, one.turn_deg) for one in near]
        away = np.array([_distance(table, tables[0]) for table in tables])
        owner, centres = np.zeros(len(near), np.int64), [0]
        away[0] = 0
        while len(centres) < min(_CENTRES, len(near)):
            centre = int(np.argmax(away))
            new = np.array([_distance(table, tables[centre]) for table in tables])
            new[centre] = 0
            owner[new < away] = len(centres)
            away = np.minimum(away, new)
            centres.append(centre)
        cells = [[near[centre]] for centre in centres]
        for one, number in zip(near, owner, strict=True):
            if one is not near[centres[number]]:
                cells[number].append(one)
        return cells


def _dense(verts: Floats, faces: Index, seed: int) -> cKDTree:
    """Return a tree of features of many samples of a surface."""
    samples = spread(verts, faces, _DENSE, seed)
    return cKDTree(features(samples.positions, samples.normals))


def _distance(own: Singles, asset: Singles) -> float:
    """Return the d of the equation at the head for features (N, 6) of a member and of the asset."""
    squares = own @ (-2 * asset.T)
    squares += np.einsum("nk,nk->n", asset, asset)
    squares += np.einsum("nk,nk->n", own, own)[:, None]
    to_asset, to_member = (np.sqrt(np.maximum(squares.min(axis), 0)) for axis in (1, 0))
    return float(0.5 * np.minimum(to_asset, _FAR).mean() + to_member.mean())
