"""Place points on the faces of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["samples_of"]

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
