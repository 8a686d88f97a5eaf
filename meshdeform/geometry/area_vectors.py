"""Compute the area vectors of faces without differentiation, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.kernels import kernel

__all__ = ["area_vectors"]

_Floats = NDArray[np.float64]


@kernel
def area_vectors(verts: _Floats, faces: NDArray[np.int64]) -> _Floats:
    """Return the cross products (F, 3) float64 of two edges of each face: normals as long as twice the area.

    Parameters
    ----------
    verts : (V, 3) floating
    faces : (F, 3) int64
    """
    cross = np.empty((len(faces), 3))
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = verts[i, 0], verts[i, 1], verts[i, 2]
        bx, by, bz = verts[j, 0] - ax, verts[j, 1] - ay, verts[j, 2] - az
        cx, cy, cz = verts[k, 0] - ax, verts[k, 1] - ay, verts[k, 2] - az
        cross[f, 0], cross[f, 1], cross[f, 2] = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    return cross
