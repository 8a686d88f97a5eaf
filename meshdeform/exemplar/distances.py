"""How far two surfaces are from each other, and how much one was distorted.

The distance is the mean over pairs of nearest samples, both ways, of

    |n . (x - y)| + max(t - s, 0),      t = |x - y| in the plane of y, s 1.5 times the spacing of the samples,

at most 0.2 of the diagonal each: not of |x - y|, which is mostly the distance between samples.

A face with corners a, b, c is stretched by the singular values of the map of its plane; the stretch of a surface is the
mean of |log s| over both of each face, weighed by area, after the scale of the whole is taken out.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.samples import Samples, features

__all__ = ["FAR", "mean_distance", "one_way_distance", "stretch"]

FAR = 0.2
_MOST = 3.0
_TINY = 1e-12


def mean_distance(one: Samples, other: Samples, spacing: float) -> float:
    """Return the mean distance between two surfaces, both ways; `spacing`: about that of their samples."""
    return (one_way_distance(one, other, spacing) + one_way_distance(other, one, spacing)) / 2


def one_way_distance(one: Samples, other: Samples, spacing: float, most: float = FAR) -> float:
    """Return the mean distance of one surface from another, of which each counts at most so much."""
    nearest = cKDTree(features(other.positions, other.normals)).query(features(one.positions, one.normals))[1]
    apart = one.positions - other.positions[nearest]
    across = (apart * other.normals[nearest]).sum(1)
    along = np.sqrt(np.maximum(np.square(apart).sum(1) - across**2, 0))
    return float(np.minimum(np.abs(across) + np.maximum(along - 1.5 * spacing, 0), most).mean())


def stretch(rest: Floats, moved: Floats, faces: Index) -> float:
    """Return the mean absolute logarithm of the stretches of the faces (F, 3) between vertices (V, 3)."""
    a, b, c = rest[faces].transpose(1, 0, 2)
    first, second = b - a, c - a
    length = np.maximum(np.linalg.norm(first, axis=1), _TINY)
    along = (first * second).sum(1) / length
    across = np.linalg.norm(np.cross(first, second), axis=1) / length
    sound = (across > 1e-3 * length) & (length > 1e-6)
    if not sound.any():
        return 0.0
    area, length, along, across = (length * across / 2)[sound], length[sound], along[sound], across[sound]
    p, q, r = moved[faces[sound]].transpose(1, 0, 2)
    u = (q - p) / length[:, None]
    v = ((r - p) - u * along[:, None]) / across[:, None]
    uu, vv, uv = (u * u).sum(1), (v * v).sum(1), (u * v).sum(1)
    middle, apart = (uu + vv) / 2, np.sqrt(np.square((uu - vv) / 2) + uv**2)
    squares = np.stack([middle + apart, np.maximum(middle - apart, 0)])
    logs = np.log(np.maximum(squares, _TINY)) / 2
    logs -= np.average(logs.mean(0), weights=area)
    return float(np.average(np.minimum(np.abs(logs), _MOST).mean(0), weights=area))
