"""Fit a simplified surface in place of a large one, which follows it: for the draft of a preview, within seconds.

It has the noun, the front and the parts that were read of the whole surface. Small parts may be lost to it, and nothing
is mended, as in no draft.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.deformation.binding import Binding
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import simplified
from meshdeform.support.recent import Recent

__all__ = ["FitSurface", "in_place_of"]

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_LARGE, _FACES = 20_000, 5000
"""Faces above which a surface is large, and about how many are fitted in its place."""
_MOST, _MOST_BYTES, _BYTES_OF_VERTEX = 8, 256 * 2**20, 400
"""How many are kept, and what one takes: its vertices' places on the other, and what averages them."""
_recent: Recent[FitSurface] = Recent(_MOST, _MOST_BYTES)


@dataclass(frozen=True)
class FitSurface:
    """What is fitted: `points` (V, 3) float64, `faces` (F, 3) int64, and the part of each face, `labels` (F,) int64.

    `binding`: by which a large surface follows it; None: it is the surface itself.
    """

    points: _Floats
    faces: _Index
    labels: _Index
    binding: Binding | None = None

    def followed(self, points: _Floats) -> _Floats:
        """Return the vertices of the surface for those that were fitted (V, 3)."""
        return points if self.binding is None else self.binding.move(points)


def in_place_of(whole: FitSurface) -> FitSurface:
    """Return a simplified surface in place of a large one; what is not large, or cannot be simplified, as it is."""
    if len(whole.faces) <= _LARGE:
        return whole
    content = hashlib.blake2b()
    for array in (whole.points, whole.faces, whole.labels):
        content.update(np.ascontiguousarray(array).tobytes())
    key = content.digest()
    found = _recent.get(key)
    if found is None:
        found = _simplified(whole)
        _recent.put(key, found, _BYTES_OF_VERTEX * len(whole.points))
    return found


def _simplified(whole: FitSurface) -> FitSurface:
    mesh = TriangleMesh(whole.points, whole.faces)
    simple = simplified(mesh, _FACES)
    if not 0 < len(simple.faces) <= _LARGE:
        return whole
    nearest = cKDTree(whole.points[whole.faces].mean(1)).query(simple.verts[simple.faces].mean(1))[1]
    return FitSurface(
        simple.verts, simple.faces, whole.labels[nearest], Binding(RestMesh.of(simple), RestMesh.of(mesh))
    )
