"""Place points on the faces of a mesh."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

__all__ = ["blend_matrix", "count_samples", "even_samples", "sample_blocks", "samples_of"]

_BLOCK = 1_000_000
"""Points of a block, but for a face that has more by itself."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


def samples_of(verts: _Floats, faces: _Index, distance: float) -> tuple[_Floats, _Index]:
    """Return points on all faces, at most `distance` apart, and the face of each."""
    points, owners = zip(*sample_blocks(verts, faces, distance), strict=True)
    return np.concatenate(points), np.concatenate(owners)


def sample_blocks(verts: _Floats, faces: _Index, distance: float) -> Iterator[tuple[_Floats, _Index]]:
    """Yield the points of `samples_of` in blocks, each with all those of its faces: large faces have thousands."""
    corners = verts[faces]
    parts = _parts(corners, distance)
    for count in np.unique(parts):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
        inside = i + j <= count
        weights = np.stack([i[inside], j[inside], count - i[inside] - j[inside]], 1) / count
        chosen = np.flatnonzero(parts == count)
        for block in np.array_split(chosen, -(-len(chosen) * len(weights) // _BLOCK)):
            yield np.einsum("sb,fbc->fsc", weights, corners[block]).reshape(-1, 3), np.repeat(block, len(weights))


def count_samples(verts: _Floats, faces: _Index, distance: float) -> float:
    """Return the number of points of `samples_of`."""
    parts = _parts(verts[faces], distance).astype(np.float64)
    return float(((parts + 1) * (parts + 2)).sum() / 2)


def _parts(corners: _Floats, distance: float) -> _Index:
    """Return the parts (F,) into which the edges of each face are divided."""
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max(1)
    return np.asarray(np.maximum(np.ceil(longest / distance).astype(int), 1))


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
