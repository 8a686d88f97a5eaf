"""Group the solids of a member that move as one, and find where groups touch and which are mirror images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from meshdeform.nouns.labels import Floats, Index, LabelledMember
from meshdeform.vocabulary.solids import PART_NAMES, parent_of

__all__ = ["Groups", "groups_of"]

_TOUCHING = 0.002
_TIED, _TIED_WITHIN = 0.03, 0.05
_MIRRORED = 0.02
_MOST_OF_A_PART = 8
"""Of a part that has more pieces, such as spikes, all move with what carries them."""
_SMALLEST = 0.02
_RIGID_NAMES = (
    "nose eye door keep window lamp bumper knob button seed book hole bridge peg text line seal mouth tooth cross crest"
    " wattle fang feeler boss belt pocket"
)
_RIGID = frozenset(_RIGID_NAMES.split())
"""Parts that move with what carries them: too small for maps of their own."""


@dataclass(frozen=True)
class Groups:
    """G groups of the solids of a member, which was placed in the asset's frame.

    `of_vert` (V,) int64; `centres` (G, 3) and `radii` (G,) float64; `ties`: pairs of groups with the point (3,) where
    they touch; `mirrored`: pairs of groups that are mirror images in the plane x = 0, a group may be its own.
    """

    of_vert: Index
    centres: Floats
    radii: Floats
    ties: list[tuple[int, int, Floats]]
    mirrored: list[tuple[int, int]]

    def __len__(self) -> int:
        return len(self.radii)

    def homogeneous(self, points: Floats, groups: Index) -> Floats:
        """Return points (N, 3) of groups (N,) in their groups' own units, with a one beside them, (N, 4)."""
        local = (points - self.centres[groups]) / self.radii[groups][:, None]
        return np.concatenate([local, np.ones((len(points), 1))], 1)


def groups_of(member: LabelledMember) -> Groups:
    """Group the touching solids of one part and side."""
    of_vert = _numbers(member)[member.solids]
    count = int(of_vert.max()) + 1
    points = [member.verts[of_vert == k] for k in range(count)]
    centres = np.array([own.mean(0) for own in points])
    radii = np.array([max(float(np.sqrt(np.square(own - own.mean(0)).sum(1).mean())), _SMALLEST) for own in points])
    mirrored = []
    for k in range(count):
        distance = np.linalg.norm(centres - centres[k] * [-1, 1, 1], axis=1)
        other = int(np.argmin(distance))
        if other <= k and distance[other] < _MIRRORED:
            mirrored.append((k, other))
    return Groups(of_vert, centres, radii, _ties(points), mirrored)


def _numbers(member: LabelledMember) -> Index:
    """Return the group (S,) of each solid."""
    parts = [_moving(PART_NAMES[number], member.parts) for number in member.part_of_solid]
    family = np.unique(parts, return_inverse=True)[1]
    owner = _joined(member, family)
    names = np.array(parts)
    for part in set(parts):
        pieces = np.unique(owner[names == part])
        above = parent_of(part, member.parts)
        if len(pieces) > _MOST_OF_A_PART and above is not None and above in parts:
            names[names == part] = above
    return _joined(member, np.unique(names, return_inverse=True)[1])


def _moving(part: str, present: tuple[str, ...]) -> str:
    """Return the part with which a part moves: itself, or what carries it."""
    while part in _RIGID:
        above = parent_of(part, present)
        if above is None:
            break
        part = above
    return part


def _joined(member: LabelledMember, family: Index) -> Index:
    """Return the number (S,) of the cluster of touching solids of one family and side that each belongs to."""
    count = len(family)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, member.solids, member.verts)
    np.maximum.at(high, member.solids, member.verts)
    middle = (low + high)[:, 0] / 2
    side = np.where(np.abs(middle) < _MIRRORED, 0, np.sign(middle))
    touch = (low[:, None] <= high[None] + _TOUCHING).all(2) & (low[None] <= high[:, None] + _TOUCHING).all(2)
    same = (family[:, None] == family[None]) & (side[:, None] * side[None] >= 0)
    return np.asarray(csgraph.connected_components(sparse.csr_matrix(touch & same), directed=False)[1], np.int64)


def _ties(points: list[Floats]) -> list[tuple[int, int, Floats]]:
    """Return the pairs of groups that touch, with the middle of the points of the first that are near the second."""
    trees = [cKDTree(own) for own in points]
    ties = []
    for i, one in enumerate(trees):
        for j, other in enumerate(trees[:i]):
            if ((one.mins > other.maxes + _TIED) | (other.mins > one.maxes + _TIED)).any():
                continue
            distance = other.query(one.data, distance_upper_bound=_TIED_WITHIN)[0]
            near = distance <= max(_TIED, 1.05 * float(distance.min()))
            if np.isfinite(distance).any() and near.any():
                ties.append((i, j, one.data[near].mean(0)))
    return ties
