"""Interpolate values between scattered points by inverse squared distance.

Source: Shepard 1968, A Two-Dimensional Interpolation Function for Irregularly-Spaced Data; here in space, and over the
nearest points only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

_NEIGHBOURS = 4
_Floats = NDArray[np.float64]


def interpolate(points: _Floats, values: _Floats, query: _Floats) -> _Floats:
    """Return the mean of the four nearest points' values; at a point itself, exactly its value.

    Parameters
    ----------
    points : (N, 3) float64
        At least one.
    values : (N, K) float64
    query : (M, 3) float64

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
