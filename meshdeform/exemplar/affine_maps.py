"""Take each piece of a surface to its partner by an affine map: articulated iterated closest points.

A point x of piece i goes to A_i h, h = ((x - c_i) / r_i, 1). The start takes the box of a piece, from the 2nd to the
98th percentile, to that of its partner; of limbs that are longer than wide, the long axis a to the partner's b:

    B = R(a -> b) (t I + (k - t) a a'),   k the ratio of lengths in 0.3 to 4, t that of widths in 0.4 to 2.5.

With samples paired by their features both ways within a piece and its partner, y and n the partner's point and normal,
each round solves the linear least squares (`reading.affine_systems`)

    sum w [ (n . (A_i h - y))^2 + 0.2 |A_i h - y|^2 ]      pairs, w = 1 / (1 + (|A_i h - y| / limit)^2); back pairs 0.7
    + l m_i |A_i - L_i|^2                                  near a similarity: L_i = 0.85 of A_i with stretches in 0.25
                                                           to 3.5, 0.15 of its closest similarity; m_i its mass
    + min(m_i, m_j) |A_i h_i(c) - A_j h_j(c)|^2            ties in the middle of a border, weaker ones beside it
    + 0.3 min(m_i, m_j) |A_i - M A_j M|^2                  mirror images alike, for a surface that is its own
    + 2 m_i (A_i h(x) - x)_y^2                             soles x of what stands on the ground, as its partner does

while l falls from 0.5 to 0.08 and the limit from 0.3 to 0.06 of the diagonal.

What has no partner keeps its size, or less; limbs of animals shrink. After the first rounds L_i is diagonal for
legs and for all that is straight, unless it leans; a wheel has one scale in its plane.

Sources: as in `reading.articulated`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.exemplar.alike import LIMBS
from meshdeform.exemplar.smooth_fit import in_ratio
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.affine_systems import (
    HOMOGENEOUS_MIRROR,
    MIRROR,
    AffineSystem,
    mapped,
    mirror_matrix,
    tie_matrix,
    turned_normals,
)
from meshdeform.reading.samples import features

__all__ = [
    "AffineMaps",
    "Cloud",
    "PieceMotion",
    "Tie",
    "articulated",
    "long_axis",
    "rotation_between",
    "touching",
]

_ROUNDS, _STRAIGHT_FROM = 14, 4
_LIMITS, _STIFFNESS = (0.3, 0.06), (0.5, 0.08)
_POINTWISE, _BACK = 0.2, 0.7
_STRETCH, _SIMILAR = (0.25, 3.5), 0.15
_LEAST_MASS, _LEAST_RADIUS, _FEWEST = 0.03, 0.015, 4
_MIRROR, _IMAGE = 0.3, 0.03
_BESIDE, _BESIDE_FREE = 0.1, 0.6
_STRAIGHT, _UPRIGHT_DEG = 3.0, 25.0
_SHRUNK, _SHRUNK_WEIGHT = 0.35, 0.05
_GROUND, _ON_GROUND, _NEAR = 2.0, 0.02, 0.04
_BOX, _LENGTHS, _WIDTHS = (0.3, 3.5), (0.3, 4.0), (0.4, 2.5)
_LONG, _NOT_BACK = 1.5, -0.3
_SHRINKING = frozenset(("tail", "horn", "ear", "feeler", "trunk", "tusk", "wing", "fin", "leg", "foot", "spike"))
"""Limbs of animals that become small where the goal has none."""


@dataclass(frozen=True)
class Cloud:
    """Samples of a surface: points (N, 3), unit normals (N, 3), the piece (N,) of each or -1."""

    positions: Floats
    normals: Floats
    pieces: Index

    def in_pieces(self) -> Cloud:
        """Return the samples that are of a piece."""
        rows = self.pieces >= 0
        return Cloud(self.positions[rows], self.normals[rows], self.pieces[rows])


@dataclass(frozen=True)
class Tie:
    """Where two pieces touch: the middle (3,) of the border, and how far it spreads."""

    one: int
    other: int
    position: Floats
    spread: float


@dataclass(frozen=True)
class PieceMotion:
    """How pieces may move: `straight`: axes stay axes; `boxed`: as boxes to boxes; `mirrored`: as mirror images do."""

    straight: bool = False
    boxed: bool = False
    mirrored: bool = False


@dataclass(frozen=True)
class AffineMaps:
    """One affine map a piece: maps (G, 3, 4), centres (G, 3) and sizes (G,)."""

    maps: Floats
    centres: Floats
    radii: Floats

    def homogeneous(self, points: Floats, pieces: Index) -> Floats:
        """Return points (N, 3) in the units of their pieces (N,), with a one beside them: (N, 4)."""
        local = (points - self.centres[pieces]) / self.radii[pieces][:, None]
        return np.concatenate([local, np.ones((len(points), 1))], 1)

    def map_points(self, points: Floats, piece: int) -> Floats:
        """Return where the map of one piece takes points (N, 3)."""
        pieces = np.full(len(points), piece)
        return mapped(self.maps, pieces, self.homogeneous(points, pieces))

    @property
    def linear(self) -> Floats:
        """The linear parts (G, 3, 3) of the maps, in the units of the surface."""
        return np.asarray(self.maps[:, :, :3] / self.radii[:, None, None])


def rotation_between(one: Floats, other: Floats) -> Floats:
    """Return the least rotation (3, 3) that takes one direction to another."""
    a, b = one / np.linalg.norm(one), other / np.linalg.norm(other)
    cross, cosine = np.cross(a, b), float(a @ b)
    squared = float(cross @ cross)
    if squared < 1e-12:
        return np.eye(3)
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew * ((1 - cosine) / squared))


def long_axis(positions: Floats, root: Floats) -> tuple[Floats, float]:
    """Return the long axis (3,) of points (N, 3), away from a root, and how much longer than wide they are."""
    middle = positions.mean(0)
    values, vectors = np.linalg.eigh(np.cov((positions - middle).T))
    axis = vectors[:, 2] * (1 if (middle - root) @ vectors[:, 2] >= 0 else -1)
    return axis, float(np.sqrt(max(values[2], 1e-12) / max(values[1], 1e-12)))


def articulated(
    source: Cloud, goal: Cloud, names: Sequence[str], partner: Index, ties: Sequence[Tie], manner: PieceMotion
) -> AffineMaps:
    """Fit the maps of the pieces of a source, `names` (G), to their partners (G,) in the goal, -1 for none."""
    fit = _Articulated(source, goal, names, partner, ties, manner)
    for number in range(_ROUNDS):
        fit.step(number)
    return fit.result()


@dataclass
class _MatchedPiece:
    """A piece with its partner: rows of its samples and of its partner's, with the tree of their features."""

    mine: Index
    others: Index
    tree: cKDTree = field(repr=False)


class _Articulated:
    """The maps of all pieces, and the system that moves them."""

    def __init__(
        self,
        source: Cloud,
        goal: Cloud,
        names: Sequence[str],
        partner: Index,
        ties: Sequence[Tie],
        manner: PieceMotion,
    ) -> None:
        self.source, self.goal, self.names, self.manner, self.ties = source, goal, names, manner, ties
        count = len(names)
        self.mass = np.bincount(source.pieces, minlength=count) / max(len(source.pieces), 1)
        self.centres, self.radii = np.zeros((count, 3)), np.full(count, 0.05)
        for piece in np.unique(source.pieces):
            own = source.positions[source.pieces == piece]
            self.centres[piece] = own.mean(0)
            self.radii[piece] = max(float(np.sqrt(np.square(own - own.mean(0)).sum(1).mean())), _LEAST_RADIUS)
        self.images = self._images() if manner.mirrored else []
        for i, j in self.images:  # so that equal maps have equal numbers on both sides
            middle = (self.centres[i] + self.centres[j] * [-1, 1, 1]) / 2
            self.centres[j] = middle * [-1, 1, 1]
            self.centres[i] = middle
            self.radii[i] = self.radii[j] = (self.radii[i] + self.radii[j]) / 2
        self.matched = self._matched_pieces(partner)
        small = not manner.straight
        lone = [k not in self.matched for k in range(count)]
        self.shrinking = np.array([small and lone[k] and name in _SHRINKING for k, name in enumerate(names)])
        self.start = np.tile(np.eye(3), (count, 1, 1))
        self.maps = np.concatenate([np.eye(3) * self.radii[:, None, None], self.centres[:, :, None]], 2)
        for piece, matched in self.matched.items():
            self._start(piece, matched)
        self.rest = self.maps.copy()
        self.h = self._h(source.positions, source.pieces)
        self.fixed = self._tie_matrix() + _MIRROR * mirror_matrix(count, self.images, self.mass + 0.01)
        self.feet = self._feet()

    def result(self) -> AffineMaps:
        """Return the maps; of what is its own mirror image, exactly alike on both sides."""
        maps = self.maps.copy()
        for i, j in self.images:
            mean = (maps[i] + MIRROR @ maps[j] @ HOMOGENEOUS_MIRROR) / 2
            maps[i], maps[j] = mean, MIRROR @ mean @ HOMOGENEOUS_MIRROR
        return AffineMaps(maps, self.centres, self.radii)

    def _matched_pieces(self, partner: Index) -> dict[int, _MatchedPiece]:
        matched = {}
        features_of_goal = features(self.goal.positions, self.goal.normals)
        for piece in np.flatnonzero(partner >= 0):
            mine = np.flatnonzero(self.source.pieces == piece)
            others = np.flatnonzero(self.goal.pieces == partner[piece])
            if min(len(mine), len(others)) >= _FEWEST:
                matched[int(piece)] = _MatchedPiece(mine, others, cKDTree(features_of_goal[others]))
        return matched

    def _h(self, points: Floats, pieces: Index) -> Floats:
        return AffineMaps(self.maps, self.centres, self.radii).homogeneous(points, pieces)

    def _start(self, piece: int, matched: _MatchedPiece) -> None:
        """Take the box, or the long axis, of a piece to its partner's."""
        mine, others = self.source.positions[matched.mine], self.goal.positions[matched.others]
        low, high = np.percentile(mine, [2, 98], axis=0)
        goal_low, goal_high = np.percentile(others, [2, 98], axis=0)
        linear = np.diag(np.clip((goal_high - goal_low) / np.maximum(high - low, 0.01), *_BOX))
        at, to = (low + high) / 2, (goal_low + goal_high) / 2
        turned = None if self.manner.boxed or self.names[piece] not in LIMBS else self._turned(piece, mine, others)
        if turned is not None:
            linear, at, to = turned, mine.mean(0), others.mean(0)
        self.start[piece] = linear
        self.maps[piece, :, :3] = linear * self.radii[piece]
        self.maps[piece, :, 3] = linear @ (self.centres[piece] - at) + to

    def _turned(self, piece: int, mine: Floats, others: Floats) -> Floats | None:
        """Return the map (3, 3) of a limb along its axis, or None if one of the two has no clear axis."""
        roots = [tie.position for tie in self.ties if piece in (tie.one, tie.other)]
        root = np.mean(roots, axis=0) if roots else self.centres[piece]
        a, longer = long_axis(mine, root)
        b, goal_longer = long_axis(others, others.mean(0) + root - self.centres[piece])
        if min(longer, goal_longer) < _LONG or a @ b < _NOT_BACK:
            return None
        length, width = _extent(mine, a)
        goal_length, goal_width = _extent(others, b)
        along = np.clip(goal_length / max(length, 1e-9), *_LENGTHS)
        across = np.clip(goal_width / max(width, 1e-9), *_WIDTHS)
        return np.asarray(rotation_between(a, b) @ (across * np.eye(3) + (along - across) * np.outer(a, a)))

    def _images(self) -> list[tuple[int, int]]:
        """Return the pairs of pieces that are mirror images; a piece may be its own."""
        pairs = []
        unlike = 9.0 * (np.array(self.names)[:, None] != np.array(self.names)[None])
        for piece in range(len(self.names)):
            away = np.linalg.norm(self.centres - self.centres[piece] * [-1, 1, 1], axis=1) + unlike[piece]
            other = int(np.argmin(away))
            if away[other] < _IMAGE and other <= piece:
                pairs.append((piece, other))
        return pairs

    def _tie_matrix(self) -> Floats:
        """Return the ties: one point in the middle of each border, three beside it so that what hangs turns along."""
        rows = []
        for tie in self.ties:
            i, j = tie.one, tie.other
            weight = min(self.mass[i], self.mass[j]) + 0.02
            beside = _BESIDE if i in self.matched and j in self.matched else _BESIDE_FREE
            beside = 0.0 if self.shrinking[i] or self.shrinking[j] else beside
            for axis in range(4):
                position = tie.position + (tie.spread * np.eye(3)[axis - 1] if axis else 0.0)
                one, other = self._h(np.stack([position, position]), np.array([i, j]))
                rows.append((i, j, one, other, weight * (beside if axis else 1.0)))
        return tie_matrix(len(self.names), rows)

    def _feet(self) -> list[tuple[int, Floats, Floats]]:
        """Return points h (P, 4) and the heights (P,) that they keep, of pieces that stand as their partners do."""
        ground, goal_ground = self.source.positions[:, 1].min(), self.goal.positions[:, 1].min()
        feet = []
        for piece, matched in self.matched.items():
            mine, others = self.source.positions[matched.mine], self.goal.positions[matched.others]
            if mine[:, 1].min() < ground + _ON_GROUND and others[:, 1].min() < goal_ground + _ON_GROUND:
                sole = mine[mine[:, 1] < mine[:, 1].min() + _ON_GROUND]
                heights = sole[:, 1] - ground + goal_ground
                feet.append((piece, self._h(sole, np.full(len(sole), piece)), heights))
        return feet

    def step(self, number: int) -> None:
        """Move the maps by one round."""
        share = number / (_ROUNDS - 1)
        system = AffineSystem(len(self.names))
        self._add_pairs(system, in_ratio(_LIMITS, share))
        self._add_goals(system, in_ratio(_STIFFNESS, share), number)
        self._add_ground(system)
        system.matrix += self.fixed
        self.maps = system.solve(1e-8)

    def _add_pairs(self, system: AffineSystem, limit: float) -> None:
        positions = mapped(self.maps, self.source.pieces, self.h)
        normals = turned_normals(self.maps, self.source.pieces, self.source.normals)
        mine_features = features(positions, normals)
        for piece, matched in self.matched.items():
            mine, others = matched.mine, matched.others
            there = others[matched.tree.query(mine_features[mine])[1]]
            back = mine[cKDTree(mine_features[mine]).query(matched.tree.data)[1]]
            source, target = np.concatenate([mine, back]), np.concatenate([there, others])
            away = np.linalg.norm(self.goal.positions[target] - positions[source], axis=1)
            facing = (self.goal.normals[target] * normals[source]).sum(1) > 0
            each = np.concatenate(
                [np.full(len(mine), 1 / len(positions)), np.full(len(others), _BACK / len(self.goal.positions))]
            )
            weight = facing * each / (1 + np.square(away / limit))
            own = np.full(len(source), piece)
            system.add_pairs(
                own, self.h[source], self.goal.positions[target], self.goal.normals[target], weight, _POINTWISE
            )

    def _add_goals(self, system: AffineSystem, stiffness: float, number: int) -> None:
        """Pull each map to what its piece may do."""
        linear = self.maps[:, :, :3] / self.radii[:, None, None]
        weights, goals = np.full((len(self.names), 3, 4), 1e-4), self.maps.copy()
        for piece, own in enumerate(linear):
            goal, weight = self._goal(piece, own, number, stiffness)
            goals[piece, :, :3] = goal * self.radii[piece]
            weights[piece, :, :3] = weight
            if self.manner.boxed and piece in self.matched and number >= _STRAIGHT_FROM:
                weights[piece, :, 3], goals[piece, :, 3] = _STRAIGHT * self.mass[piece], self.rest[piece, :, 3]
        system.add_goals(weights, goals)

    def _goal(self, piece: int, linear: Floats, number: int, stiffness: float) -> tuple[Floats, float]:
        """Return where the linear part of a map is pulled, and how much."""
        u, stretches, v = np.linalg.svd(linear)
        u[:, 2] *= np.sign(np.linalg.det(u @ v))
        stretches[2] *= np.sign(np.linalg.det(linear))
        rotation, kept = u @ v, (u * np.clip(stretches, *_STRETCH)) @ v
        mean = float(np.exp(np.log(np.clip(np.abs(stretches), 0.05, 9)).mean()))
        mass = max(self.mass[piece], _LEAST_MASS)
        if self.shrinking[piece]:
            return rotation * _SHRUNK, _SHRUNK_WEIGHT
        straight = self._straight(piece, kept, rotation) if number >= _STRAIGHT_FROM else None
        if straight is not None:
            return straight, _STRAIGHT * mass
        if piece not in self.matched:
            return rotation * min(max(mean, 0.5), 1.0), 2 * stiffness * mass
        return (1 - _SIMILAR) * kept + _SIMILAR * mean * rotation, stiffness * mass

    def _straight(self, piece: int, kept: Floats, rotation: Floats) -> Floats | None:
        """Return the map of a piece whose axes stay axes, or None if they need not."""
        name = self.names[piece]
        if name == "wheel":
            return np.eye(3) * float(np.sqrt(max(np.linalg.det(kept[1:, 1:]), 1e-3)))
        if not self.manner.straight and name != "leg":
            return None
        if piece in self.matched:
            degrees = np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))
            if degrees >= _UPRIGHT_DEG:
                return None
            return np.diag(np.clip(np.diag(self.start[piece] if self.manner.boxed else kept), 0.25, 4.0))
        if not self.manner.straight:
            return None
        beside = [tie.other if tie.one == piece else tie.one for tie in self.ties if piece in (tie.one, tie.other)]
        scales = [np.diag(self.maps[k, :, :3] / self.radii[k]) for k in beside if k in self.matched]
        return np.diag(np.mean(scales, axis=0)) if scales else np.eye(3)

    def _add_ground(self, system: AffineSystem) -> None:
        """Keep the height of what stands on the ground."""
        for piece, h, heights in self.feet:
            rows = slice(12 * piece + 4, 12 * piece + 8)
            weight = _GROUND * self.mass[piece] / len(h)
            system.matrix[rows, rows] += weight * h.T @ h
            system.right[rows] += weight * heights @ h


def _extent(positions: Floats, axis: Floats) -> tuple[float, float]:
    """Return the length of points along an axis, and their root mean square distance across it."""
    apart = positions - positions.mean(0)
    along = apart @ axis
    low, high = np.percentile(along, [3, 97])
    return float(high - low), float(np.sqrt(max(np.square(apart).sum(1).mean() - np.square(along).mean(), 1e-6)))


def touching(cloud: Cloud, count: int, borders: dict[tuple[int, int], Floats]) -> list[Tie]:
    """Return the ties of pieces: by the points (P, 3) of borders that they share, else by samples that are near."""
    ties = []
    trees = {k: cKDTree(cloud.positions[cloud.pieces == k]) for k in range(count) if (cloud.pieces == k).any()}
    for i in range(count):
        for j in range(i):
            positions = borders.get((j, i))
            if positions is None:
                if i not in trees or j not in trees:
                    continue
                away, nearest = trees[j].query(trees[i].data)
                if away.min() >= _NEAR:
                    continue
                close = away <= away.min() * 1.2 + 0.01
                positions = (trees[i].data[close] + trees[j].data[nearest[close]]) / 2
            spread = max(float(np.sqrt(np.square(positions - positions.mean(0)).sum(1).mean())), 0.01)
            ties.append(Tie(j, i, positions.mean(0), spread))
    return ties
