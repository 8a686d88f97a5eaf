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


def interpolate(points: _Floats, values: _Floats, wanted: _Floats) -> _Floats:
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
    count = min(_NEIGHBOURS, len(points))
    distance, near = cKDTree(points).query(wanted, k=[*range(1, count + 1)])
    nearest = distance[:, :1]
    at_point = nearest == 0.0
    ratio = nearest / np.where(distance > 0.0, distance, 1.0)
    weight = np.where(at_point, distance == 0.0, ratio**2)
    weight = weight / weight.sum(axis=1, keepdims=True)
    return np.asarray((weight[:, :, None] * values[near]).sum(axis=1))
