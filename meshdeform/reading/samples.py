"""Spread points over surfaces by area, and compare two surfaces by such points.

The features of a point x with unit normal n are (x, NORMAL_WEIGHT n), in a frame in which the diagonal of the box is 1;
near features are near points whose surfaces face alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["NORMAL_WEIGHT", "Samples", "features", "hidden", "resampled", "spread"]

NORMAL_WEIGHT = 0.12
"""Length of a unit normal beside points, a share of the diagonal."""
_BEHIND = 0.004
"""How far inside another solid a point is hidden, as a share of the diagonal."""


class Samples(NamedTuple):
    """Places (N, 3) float64 on faces (N,) int64 with unit normals (N, 3) and their shares (N, 3) of the corners."""

    positions: Floats
    normals: Floats
    faces: Index
    shares: Floats

    def rows(self, kept: Flags | Index) -> Samples:
        """Return some of the samples."""
        return Samples(self.positions[kept], self.normals[kept], self.faces[kept], self.shares[kept])


def area_vectors(verts: Floats, faces: Index) -> Floats:
    """Return the normals (F, 3) of faces, as long as twice their areas."""
    a, b, c = verts[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def spread(verts: Floats, faces: Index, count: int, seed: int) -> Samples:
    """Return points evenly spread by area; always the same for a seed."""
    rng = np.random.default_rng(seed)
    areas = np.linalg.norm(area_vectors(verts, faces), axis=1)
    ends = np.cumsum(areas)
    chosen = np.searchsorted(ends, (np.arange(count) + rng.random(count)) / count * ends[-1]).clip(0, len(faces) - 1)
    root, along = np.sqrt(rng.random(count)), rng.random(count)
    shares = np.stack([1 - root, root * (1 - along), root * along], 1)
    return resampled(verts, faces, chosen, shares)


def resampled(verts: Floats, faces: Index, chosen: Index, shares: Floats) -> Samples:
    """Return the samples at shares (N, 3) of the corners of chosen faces (N,)."""
    normals = area_vectors(verts, faces[chosen])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return Samples(np.einsum("nk,nkj->nj", shares, verts[faces[chosen]]), normals, chosen, shares)


def features(positions: Floats, normals: Floats, weight: float = NORMAL_WEIGHT) -> Floats:
    """Return points and weighted normals side by side, (N, 6)."""
    return np.hstack([positions, weight * normals])


def hidden(samples: Samples, solids: Index) -> Flags:
    """Return which samples (N,) lie inside another closed solid; `solids` (N,) int64 is the solid of each.

    A point is inside if it is behind the nearest three samples of the other solid.
    """
    inside = np.zeros(len(solids), bool)
    order = np.argsort(solids, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(solids[order])) + 1):
        if len(rows) < 8:
            continue
        own = samples.positions[rows]
        within = (samples.positions > own.min(0)).all(1) & (samples.positions < own.max(0)).all(1)
        near = np.flatnonzero(within & ~inside & (solids != solids[rows[0]]))
        if len(near):
            nearest = rows[cKDTree(own).query(samples.positions[near], k=3)[1]]
            depth = ((samples.positions[near][:, None] - samples.positions[nearest]) * samples.normals[nearest]).sum(2)
            inside[near[(depth < -_BEHIND).all(1)]] = True
    return inside
