"""Find points at the same place, and what they connect. Without torch, because the check of assets uses it.

Interpolate values between scattered points by inverse squared distance.

Source: Shepard 1968, A Two-Dimensional Interpolation Function for Irregularly-Spaced Data; here in space, and over the
nearest points only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

WELD_TOLERANCE = 1e-6
"""Distance, as a share of the bounding box diagonal, up to which vertices of an asset are at the same place."""
_NEIGHBOURS = 4
_Floats = NDArray[np.float64]


def coincident(points: NDArray[np.float64], distance: float) -> NDArray[np.int64]:
    """Return the index (N,) of the representative of each point (N, 3): the first one within `distance`.

    Exact duplicates are merged first; then each point joins the earliest representative within `distance`. Points join
    representatives only, so a chain of close points (a detail finer than the tolerance) is thinned out, not merged into
    one point.
    """
    label = _first_of_each(points + 0.0)  # + 0.0 turns -0 into 0
    if distance <= 0:
        return label
    # Keep one point per cell, which bounds the number of pairs below even if many points are in one place.
    label = _first_of_each(np.floor((points - points.min(0)) / distance))[label]
    unique = np.unique(label)
    pairs = cKDTree(points[unique]).query_pairs(distance, output_type="ndarray")
    target = np.arange(len(points))
    for low, high in unique[pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]]:
        if target[low] == low and target[high] == high:
            target[high] = low
    return target[label]


def connected_triangles(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the connected component (T,) of each triangle; vertices at exactly the same place are one."""
    order = np.lexsort(points.T)
    place = np.empty(len(points), np.int64)
    place[order] = np.cumsum((np.diff(points[order], axis=0, prepend=np.nan) != 0).any(1)) - 1
    corners = place[triangles]
    ends = np.concatenate([corners[:, :2], corners[:, 1:]])
    shape = (len(points), len(points))
    graph = sparse.csr_matrix((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=shape)
    labels = csgraph.connected_components(graph, directed=False)[1]
    return np.asarray(labels[corners[:, 0]], np.int64)


def _first_of_each(rows: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the index of the first row that equals each row."""
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first[inverse.reshape(-1)].astype(np.int64)


def interpolate(points: _Floats, values: _Floats, query: _Floats) -> _Floats:
    """Return the mean of the four nearest points' values; at a point itself, exactly its value.

    Parameters
    ----------
    points : (N, 3) float64
        At least one.
    values : (N, K) float64
    wanted : (M, 3) float64

    Returns
    -------
    (M, K) float64
    """
    near, weight = _nearest(points, query)
    return np.asarray((weight[:, :, None] * values[near]).sum(axis=1))


def mapped(points: _Floats, moved: _Floats, jacobians: _Floats, query: _Floats) -> tuple[_Floats, _Floats]:
    """Return how the affine maps around the four nearest points move others; an affine map of all moves all exactly.

    Parameters
    ----------
    points, moved : (N, 3) float64
        At least one, and their displacements.
    jacobians : (N, 3, 3) float64
        The linear map around each point.
    query : (M, 3) float64

    Returns
    -------
    Displacements (M, 3) float64, and linear maps (M, 3, 3).
    """
    near, weight = _nearest(points, query)
    arms = np.einsum("mkij,mkj->mki", jacobians[near] - np.eye(3), query[:, None] - points[near])
    shift = (weight[:, :, None] * (moved[near] + arms)).sum(axis=1)
    return shift, np.einsum("mk,mkij->mij", weight, jacobians[near])


def _nearest(points: _Floats, query: _Floats) -> tuple[NDArray[np.int64], _Floats]:
    """Return the four nearest points (M, K) of each of a query, and how much each counts."""
    count = min(_NEIGHBOURS, len(points))
    distance, near = cKDTree(points).query(query, k=[*range(1, count + 1)])
    nearest = distance[:, :1]
    at_point = nearest == 0.0
    ratio = nearest / np.where(distance > 0.0, distance, 1.0)
    weight = np.where(at_point, distance == 0.0, ratio**2)
    return near, weight / weight.sum(axis=1, keepdims=True)
