"""Sample the surface of a mesh: on a grid of each face, evenly by area, or as blue noise."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from meshdeform.geometry.folds import area_vectors

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
    divisions = _divisions(corners, distance)
    for count in np.unique(divisions):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
        inside = i + j <= count
        weights = np.stack([i[inside], j[inside], count - i[inside] - j[inside]], 1) / count
        chosen = np.flatnonzero(divisions == count)
        for block in np.array_split(chosen, -(-len(chosen) * len(weights) // _BLOCK)):
            yield np.einsum("sb,fbc->fsc", weights, corners[block]).reshape(-1, 3), np.repeat(block, len(weights))


def count_samples(verts: _Floats, faces: _Index, distance: float) -> float:
    """Return the number of points of `samples_of`."""
    divisions = _divisions(verts[faces], distance).astype(np.float64)
    return float(((divisions + 1) * (divisions + 2)).sum() / 2)


def _divisions(corners: _Floats, distance: float) -> _Index:
    """Return into how many segments (F,) the edges of each face are divided."""
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max(1)
    return np.asarray(np.maximum(np.ceil(longest / distance).astype(int), 1))


def even_samples(areas: _Floats, count: int, seed: int, *, independent: bool = False) -> tuple[_Index, _Floats]:
    """Draw samples evenly on a surface.

    Parameters
    ----------
    areas : (F,) float64
        Areas of the faces, or other weights; at least one is positive.
    independent : bool
        Whether each is drawn by itself (white noise), not in its share of the area.

    Returns
    -------
    The face of each sample (count,), ascending, and its barycentric coordinates (count, 3).
    """
    random = np.random.default_rng(seed)
    bounds = np.cumsum(areas / areas.sum())
    shares = np.sort(random.random(count)) if independent else (np.arange(count) + random.random(count)) / count
    face = np.minimum(np.searchsorted(bounds, shares, side="right"), np.flatnonzero(areas > 0)[-1])
    root, share = np.sqrt(random.random(count)), random.random(count)
    return face, np.stack([1 - root, root * (1 - share), root * share], 1)


def surface_samples(
    verts: _Floats, faces: _Index, count: int, seed: int, *, independent: bool = False
) -> tuple[_Floats, _Floats]:
    """Return points (count, 3) drawn evenly on a mesh (`even_samples`), and the unit normals (count, 3) there."""
    cross = area_vectors(verts, faces)
    twice = np.linalg.norm(cross, axis=1)
    face, weights = even_samples(twice, count, seed, independent=independent)
    return np.einsum("pk,pkc->pc", weights, verts[faces[face]]), cross[face] / twice[face, None]


def blue_samples(verts: _Floats, faces: _Index, count: int, seed: int) -> tuple[_Floats, _Floats]:
    """Return points (count, 3) on a mesh of which no two of the same side are near each other, and their normals.

    Of five times as many, that with the most and nearest neighbours is left out, again and again.

    Source: Yuksel 2015, Sample Elimination for Generating Poisson Disk Sample Sets, section 3.
    """
    points, normals = surface_samples(verts, faces, 5 * count, seed)
    area = np.linalg.norm(area_vectors(verts, faces), axis=1).sum() / 2
    reach = 2 * math.sqrt(area / (2 * math.sqrt(3) * count))  # of the densest packing
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    one, other = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(1) > 0].T
    least = 0.65 * (1 - 5**-1.5) * reach
    apart = np.maximum(np.linalg.norm(points[one] - points[other], axis=1), least)
    near = sparse.coo_matrix(((1 - apart / reach) ** 8, (one, other)), shape=(len(points), len(points))).tocsr()
    near = (near + near.T).tocsr()
    crowd = near.sum(1).A1
    heap = [(-value, i) for i, value in enumerate(crowd.tolist())]
    heapq.heapify(heap)
    kept = np.ones(len(points), bool)
    while len(heap) > count:
        value, i = heapq.heappop(heap)
        if -value > crowd[i]:  # some of its neighbours are gone since
            heapq.heappush(heap, (-float(crowd[i]), i))
            continue
        kept[i] = False
        row = slice(near.indptr[i], near.indptr[i + 1])
        crowd[near.indices[row]] -= near.data[row]
    return points[kept], normals[kept]
