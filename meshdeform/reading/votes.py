"""Carry the parts of fitted members over to the cells of an asset.

The cost of a part at a point is the distance of features to the nearest sample of that part on the fitted member's
outside, with normals weighed 0.04; at a point inside another component of the asset, also to what is inside. The
probability of a part is

    p = exp(-(cost - least cost) / 0.012), normalised,

the mean over points of the cell, and over members, weighed exp(-(score - best score) / 0.003).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.articulated import MemberFit
from meshdeform.reading.cells import Cells
from meshdeform.reading.samples import Samples, features, hidden, spread

__all__ = ["TRUST", "counted", "part_votes"]

_SHARP = 0.012
_NORMALS = 0.04
TRUST = 0.003
"""Difference of scores, shares of the diagonal, that makes a member count less by e."""
_SAMPLES, _NEAREST = 4000, 24
_POINTS, _MOST_POINTS = 3000, 40


def part_votes(verts: Floats, faces: Index, cells: Cells, fits: Sequence[MemberFit], parts: Index) -> Floats:
    """Return the probability (M, C, P) of each of the parts, indices in `PART_NAMES`, on each cell, by each fit."""
    positions, normals, of_cell = _points_on(verts, faces, cells)
    asked = features(positions, normals, _NORMALS)
    inside = hidden(Samples(positions, normals, of_cell, positions), cells.components[of_cell])
    each = np.bincount(of_cell, minlength=len(cells))[:, None]
    votes = []
    for fit in fits:
        likely = _likely(fit, asked, inside, parts)
        votes.append(np.stack([np.bincount(of_cell, column, len(cells)) for column in likely.T], 1) / each)
    return np.stack(votes)


def counted(votes: Floats, fits: Sequence[MemberFit]) -> Floats:
    """Return the probability (C, P) of each part by all fits together."""
    weights = np.exp([-(fit.score - fits[0].score) / TRUST for fit in fits])
    return np.asarray(np.einsum("m,mcp->cp", weights / weights.sum(), votes))


def _likely(fit: MemberFit, asked: Floats, inside: Flags, parts: Index) -> Floats:
    """Return the probability (N, P) of the parts at points, by one member; `inside`: those inside another component."""
    member = fit.member
    samples = spread(member.verts, member.faces, _SAMPLES, 5)
    shown = ~hidden(samples, member.solid_of_face[samples.faces])
    column = np.searchsorted(parts, member.labels[samples.faces])
    cost = np.full((len(asked), len(parts)), np.inf)
    for rows, kept in ((~inside, np.flatnonzero(shown)), (inside, np.arange(len(shown)))):
        if not rows.any():
            continue
        tree = cKDTree(features(samples.positions[kept], samples.normals[kept], _NORMALS))
        distance, near = tree.query(asked[rows], k=min(_NEAREST, len(kept)))
        own = np.full((len(near), len(parts)), np.inf)
        for k in range(near.shape[1] - 1, -1, -1):  # the nearest last, so that it stays
            own[np.arange(len(near)), column[kept[near[:, k]]]] = distance[:, k]
        cost[rows] = own
    likely = np.exp(-(cost - cost.min(1, keepdims=True)) / _SHARP)
    return np.asarray(likely / likely.sum(1, keepdims=True))


def _points_on(verts: Floats, faces: Index, cells: Cells) -> tuple[Floats, Floats, Index]:
    """Return points (N, 3) on the cells, more on large ones, their normals (N, 3) and the cell (N,) of each."""
    share = cells.areas / cells.areas.sum()
    count = np.clip(np.ceil(share * _POINTS), 1, _MOST_POINTS).astype(int)
    of_cell = np.repeat(np.arange(len(cells)), count)
    random = np.random.default_rng(0).random((len(of_cell), 2))
    random = np.where(random.sum(1, keepdims=True) > 1, 1 - random, random)
    shares = np.column_stack([1 - random.sum(1), random])
    shares[np.concatenate([[0], np.cumsum(count)[:-1]])] = 1 / 3
    positions = np.einsum("nk,nkj->nj", shares, verts[faces[cells.face[of_cell]]])
    return positions, cells.normals[of_cell], of_cell
