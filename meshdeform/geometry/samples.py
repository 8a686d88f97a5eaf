"""Place points on the faces of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

__all__ = ["blend_matrix", "even_samples", "samples_of"]

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


def samples_of(verts: _Floats, faces: _Index, distance: float) -> tuple[_Floats, _Index]:
    """Return points on all faces, at most `distance` apart, and the face of each."""
    corners = verts[faces]
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max(1)
    parts = np.maximum(np.ceil(longest / distance).astype(int), 1)
    points, owners = [], []
    for count in np.unique(parts):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
        inside = i + j <= count
        weights = np.stack([i[inside], j[inside], count - i[inside] - j[inside]], 1) / count
        chosen = np.flatnonzero(parts == count)
        points.append(np.einsum("sb,fbc->fsc", weights, corners[chosen]).reshape(-1, 3))
        owners.append(np.repeat(chosen, len(weights)))
    return np.concatenate(points), np.concatenate(owners)


def even_samples(areas: _Floats, count: int, seed: int) -> tuple[_Index, _Floats]:
    """Place samples evenly on a surface.

    Parameters
    ----------
    areas : (F,) float64
        Areas of the faces, or other weights; at least one is positive.
    count : int
    seed : int

    Returns
    -------
    The face of each sample (count,), ascending, and its barycentric coordinates (count, 3).
    """
    random = np.random.default_rng(seed)
    bounds = np.cumsum(areas / areas.sum())
    places = (np.arange(count) + random.random(count)) / count
    face = np.minimum(np.searchsorted(bounds, places, side="right"), np.flatnonzero(areas > 0)[-1])
    root, share = np.sqrt(random.random(count)), random.random(count)
    return face, np.stack([1 - root, root * (1 - share), root * share], 1)


def blend_matrix(corners: _Index, weights: _Floats, count: int) -> sparse.csr_matrix:
    """Return the matrix (P, V) that interpolates values of `count` vertices at places on faces.

    Parameters
    ----------
    corners : (P, 3) int64
    weights : (P, 3) float64
        Barycentric coordinates.
    count : int
    """
    rows = np.arange(len(corners) + 1) * 3
    return sparse.csr_matrix((weights.ravel(), corners.ravel(), rows), shape=(len(corners), count))
