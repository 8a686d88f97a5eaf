"""Continue distances that are only stored in a band around the surface.

Level sets and truncated distances are a constant beyond their band. Its gradient is zero, so nothing there could be
projected to the surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

_Floats = NDArray[np.float64]


def continued(values: _Floats, spacing: _Floats) -> _Floats:
    """Return the values (X, Y, Z) with distances beyond their band: those of its nearest voxel, and the way from there.

    Parameters
    ----------
    values : (X, Y, Z) float64
        Signed distances. If no voxel has the value of all its neighbours, they are returned as they are.
    spacing : (3,) float64
    """
    flat, crossed = np.ones(values.shape, np.bool_), np.zeros(values.shape, np.bool_)
    for axis in range(3):
        along, level, changes = (np.moveaxis(array, axis, 0) for array in (values, flat, crossed))
        same, change = along[1:] == along[:-1], (along[1:] < 0) != (along[:-1] < 0)
        for part in (slice(1, None), slice(None, -1)):
            level[part] &= same
            changes[part] |= change
    beyond = np.zeros(values.shape, np.bool_)
    for side in (values, -values):
        constant = side[flat & (side > 0)]
        if len(constant):
            beyond |= side >= (1 - 1e-6) * constant.min()
    beyond &= ~crossed  # these are what the surface is made of, however thin the band
    if not beyond.any():
        return values
    way, nearest = distance_transform_edt(beyond, sampling=spacing, return_indices=True)
    return np.where(beyond, np.copysign(np.abs(values[tuple(nearest)]) + way, values), values)
