"""Tell how a body holds its limbs, how unlike two postures are, and give a member the posture of an asset.

A limb has a middle and an axis, the first principal axis of points on it, which points away from the middle of the
body; its slenderness is the ratio of the standard deviations along the first two axes. The head's axis is the direction
to it from the body. Two postures differ by

    sum_k w_k max(angle_k - 8 deg, 0) / 90 deg / sum_k w_k

over the limbs of one kind that are matched by where they are in the boxes; w_k falls to 0 for limbs that are no longer
than wide, which have no direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meshdeform.exemplar.affine_maps import rotation_between
from meshdeform.geometry.mesh import face_cross
from meshdeform.nouns.labels import Floats, Index, LabelledMember
from meshdeform.nouns.limbs import LIMBS, NO_LIMB, SEVERAL, kind_of, limb_codes

__all__ = ["Posture", "held_like", "postures", "unlikeness"]

AnyFloats = NDArray[np.floating]
Integers = NDArray[np.integer]

_LEAST_SAMPLES = 8
_WEIGHTS = dict(zip(LIMBS, (1.5, 0.8, 0.8, 0.3, 0.5, 0.7, 1.0), strict=True))
_FREE_DEG = 8.0
_SLENDER = (1.2, 2.0)
"""Slenderness from which a direction counts, and from which it counts fully."""
_AXES = np.array([1.5, 0.5, 1.0])
_KINDS = {name: number for number, name in enumerate(LIMBS)}
_TURNED = {"leg": (2.2, 1.3, 75.0), "arm": (2.2, 1.3, 120.0), "wing": (1.6, 1.3, 120.0)}
"""Slenderness of the asset's limb and of the member's from which it is turned, and the most degrees."""
_LEAST_TURN_DEG, _EVEN_DEG = 15.0, 12.0
_ROOT, _IMAGE = 0.15, 0.12


@dataclass(frozen=True)
class Posture:
    """The limbs of a body: `kinds` (K,) int64, indices in `LIMBS`; `middles` and `axes` (K, 3); `slender` (K,).

    `middles` are in the box of the whole, from 0 to 1.
    """

    kinds: Index
    middles: Floats
    axes: Floats
    slender: Floats


def postures(positions: AnyFloats, limbs: Integers, low: AnyFloats, high: AnyFloats) -> list[Posture]:
    """Return the postures of M bodies by samples.

    `positions` (M, N, 3); `limbs` (M, N): their codes (`nouns.limbs`); `low`, `high` (M, 3): the boxes.
    """
    count = len(positions)
    codes = (np.arange(count)[:, None] * (NO_LIMB + 1) + limbs).ravel()
    used, own, number = np.unique(codes, return_inverse=True, return_counts=True)
    flat = positions.reshape(-1, 3).astype(np.float64)
    middles = np.stack([np.bincount(own, flat[:, axis]) for axis in range(3)], 1) / number[:, None]
    apart = flat - middles[own]
    spread = np.zeros((len(used), 3, 3))
    np.add.at(spread, own, apart[:, :, None] * apart[:, None])
    values, vectors = np.linalg.eigh(spread / number[:, None, None])
    slender = np.sqrt(np.maximum(values[:, 2], 1e-12) / np.maximum(values[:, 1], 1e-12))
    body_of, code = np.divmod(used, NO_LIMB + 1)
    found = (code != NO_LIMB) & (number >= _LEAST_SAMPLES)
    result = []
    for body in range(count):
        rows = np.flatnonzero(found & (body_of == body))
        kinds = np.asarray(kind_of(code[rows]), np.int64)
        axes = _oriented(kinds, middles[rows], vectors[rows, :, 2])
        inside = (middles[rows] - low[body]) / np.maximum(high[body] - low[body], 1e-9)
        is_head = kinds == _KINDS["head"]
        result.append(Posture(kinds, inside, axes, np.where(is_head, _SLENDER[1], slender[rows])))
    return result


def _oriented(kinds: Index, middles: Floats, axes: Floats) -> Floats:
    """Return the axes (K, 3) away from the body; the body's own up and forward, the head's from the body to it."""
    axes = axes.copy()
    body, head = np.flatnonzero(kinds == _KINDS["body"]), np.flatnonzero(kinds == _KINDS["head"])
    root = middles[body[0]] if len(body) else middles.mean(0) if len(middles) else np.zeros(3)
    away = middles - root
    away[body] = [0.0, 1.0, 1.0]
    axes *= np.where((axes * away).sum(1) < 0, -1.0, 1.0)[:, None]
    if len(body) and len(head):
        axes[head] = away[head] / np.maximum(np.linalg.norm(away[head], axis=1, keepdims=True), 1e-9)
    return axes


def unlikeness(asset: Posture, member: Posture) -> float:
    """Return how differently two bodies hold their limbs, by the equation at the head; 0 if nothing can be told."""
    total, weight = 0.0, 0.0
    for one, other in _pairs(asset, member):
        slender = min(asset.slender[one], member.slender[other])
        sure = np.clip((slender - _SLENDER[0]) / (_SLENDER[1] - _SLENDER[0]), 0, 1)
        angle = np.degrees(np.arccos(np.clip(asset.axes[one] @ member.axes[other], -1, 1)))
        own = _WEIGHTS[LIMBS[asset.kinds[one]]] * float(sure)
        total += own * max(float(angle) - _FREE_DEG, 0.0) / 90
        weight += own
    return total / weight if weight else 0.0


def _pairs(asset: Posture, member: Posture) -> list[tuple[int, int]]:
    """Return the limbs of both that are of one kind and lie alike."""
    pairs: list[tuple[int, int]] = []
    for kind in np.intersect1d(asset.kinds, member.kinds):
        mine, others = np.flatnonzero(asset.kinds == kind), np.flatnonzero(member.kinds == kind)
        if len(mine) == len(others) == 1:
            pairs.append((int(mine[0]), int(others[0])))
            continue
        from scipy.optimize import linear_sum_assignment  # takes long to import, and most have no limbs

        apart = (asset.middles[mine][:, None] - member.middles[others]) * _AXES
        rows, columns = linear_sum_assignment(np.linalg.norm(apart, axis=2))
        pairs += [(int(mine[row]), int(others[column])) for row, column in zip(rows, columns, strict=True)]
    return pairs


def held_like(member: LabelledMember, asset: Posture) -> LabelledMember:
    """Return the member with legs, arms and wings turned about where they hang, to the directions of the asset's."""
    codes = limb_codes(member)
    used = np.unique(codes[codes != NO_LIMB])
    if not len(used):
        return member
    own, asset = _posture_of(member, codes, used), _evened(asset)
    verts = member.verts.copy()
    for one, other in _pairs(asset, own):
        kind = LIMBS[asset.kinds[one]]
        if kind not in _TURNED:
            continue
        least, least_own, most = _TURNED[kind]
        if asset.slender[one] < least or own.slender[other] < least_own:
            continue
        axis, goal = own.axes[other], asset.axes[one]
        angle = float(np.degrees(np.arccos(np.clip(axis @ goal, -1, 1))))
        if _LEAST_TURN_DEG < angle < most:
            rows = np.unique(member.faces[codes == used[other]])
            root = _root(verts[rows], axis)
            verts[rows] = (verts[rows] - root) @ rotation_between(axis, goal).T + root
    return member.moved(verts)


def _evened(posture: Posture) -> Posture:
    """Return the posture with the axes of limbs that are nearly mirror images made exactly so."""
    axes, mirror = posture.axes.copy(), np.array([-1.0, 1.0, 1.0])
    for one in np.flatnonzero(np.isin(posture.kinds, [_KINDS[name] for name in SEVERAL])):
        image = [1, 0, 0] + posture.middles[one] * mirror
        apart = np.linalg.norm(posture.middles - image, axis=1) + 9.0 * (posture.kinds != posture.kinds[one])
        other = int(np.argmin(apart))
        if apart[other] < _IMAGE and posture.axes[one] @ (posture.axes[other] * mirror) > np.cos(np.radians(_EVEN_DEG)):
            mean = posture.axes[one] + posture.axes[other] * mirror
            axes[one] = mean / np.linalg.norm(mean)
    return replace(posture, axes=axes)


def _posture_of(member: LabelledMember, codes: Index, used: Index) -> Posture:
    """Return the posture of a member, with a row for each of its limbs."""
    centres = member.verts[member.faces].mean(1)
    areas = np.linalg.norm(face_cross(member.verts, member.faces), axis=1)
    kinds = np.asarray(kind_of(used), np.int64)
    middles, axes, slender = np.zeros((len(used), 3)), np.zeros((len(used), 3)), np.ones(len(used))
    for number, code in enumerate(used):
        rows = codes == code
        middles[number] = np.average(centres[rows], axis=0, weights=areas[rows])
        apart = centres[rows] - middles[number]
        values, vectors = np.linalg.eigh((apart * areas[rows, None]).T @ apart / areas[rows].sum())
        axes[number], slender[number] = vectors[:, 2], np.sqrt(max(values[2], 1e-12) / max(values[1], 1e-12))
    low, high = member.verts.min(0), member.verts.max(0)
    inside = (middles - low) / np.maximum(high - low, 1e-9)
    return Posture(kinds, inside, _oriented(kinds, middles, axes), slender)


def _root(positions: Floats, axis: Floats) -> Floats:
    """Return where (3,) a limb hangs: the middle of its end against its axis."""
    along = positions @ axis
    return np.asarray(positions[along <= along.min() + _ROOT * np.ptp(along)].mean(0))
