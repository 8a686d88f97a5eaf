"""Find points at the same position, and what they connect. Without torch, because the check of assets uses it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

WELD_TOLERANCE = 1e-6
"""Distance, as a share of the bounding box diagonal, up to which vertices of an asset are at the same position."""


def coincident(points: NDArray[np.float64], distance: float) -> NDArray[np.int64]:
    """Return the index (N,) of the representative of each point (N, 3): the first one within `distance`.

    Exact duplicates are merged first; then each point joins the earliest representative within `distance`. Points join
    representatives only, so a chain of close points (a detail finer than the tolerance) is thinned out, not merged into
    one point.
    """
    label = _first_of_each(points + 0.0)  # + 0.0 turns -0 into 0
    if distance <= 0:
        return label
    # Keep one point per cell, which bounds the number of pairs below even if many points are in one position.
    label = _first_of_each(np.floor((points - points.min(0)) / distance))[label]
    unique = np.unique(label)
    pairs = cKDTree(points[unique]).query_pairs(distance, output_type="ndarray")
    target = np.arange(len(points))
    for low, high in unique[pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]]:
        if target[low] == low and target[high] == high:
            target[high] = low
    return target[label]


def connected_triangles(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the connected component (T,) of each triangle; vertices at exactly the same position are one."""
    order = np.lexsort(points.T)
    position = np.empty(len(points), np.int64)
    position[order] = np.cumsum((np.diff(points[order], axis=0, prepend=np.nan) != 0).any(1)) - 1
    corners = position[triangles]
    ends = np.concatenate([corners[:, :2], corners[:, 1:]])
    shape = (len(points), len(points))
    graph = sparse.csr_matrix((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=shape)
    labels = csgraph.connected_components(graph, directed=False)[1]
    return np.asarray(labels[corners[:, 0]], np.int64)


def _first_of_each(rows: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the index of the first row that equals each row."""
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first[inverse.reshape(-1)].astype(np.int64)
