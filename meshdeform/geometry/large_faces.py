"""Find the few large faces of a mesh that stand next to small ones of other components."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.nearest_points import nearest_on_triangle

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class LargeFaces:
    """Some faces of a mesh: `corners` (F, 3, 3), `areas` (F,) and the `components` (F,) to which they belong."""

    corners: _Floats
    areas: _Floats
    components: _Index


class _Candidates(NamedTuple):
    """Large faces with the boxes (F, 3) around them, widened by the reach of a search."""

    corners: _Floats
    areas: _Floats
    components: _Index
    low: _Floats
    high: _Floats


class _Found(NamedTuple):
    """The nearest face of each point (P,), its squared distance (P,) and its barycentric coordinates (P, 3)."""

    face: _Index
    squared: _Floats
    weights: _Floats


def nearest_larger_faces(
    points: _Floats, sizes: _Floats, components: _Index, faces: LargeFaces, contact: float, reach: float
) -> tuple[_Index, _Floats, _Floats]:
    """Find for each point the nearest face that is larger than it, of another component that its own one touches.

    `points` is (P, 3) float64; `sizes`, (P,) float64: the area that a face must exceed; `components` is (P,) int64;
    `faces`: few: all points are compared with all; `contact`: a component touches another one if one of its points is
    at most this far from one of the faces; `reach`: greatest distance of a point from its face. Returns (P,) int64, -1
    where there is none; the barycentric coordinates (P, 3) there; their distances (P,).
    """
    count = 1 + max(int(components.max(initial=0)), int(faces.components.max(initial=0)))

    def search(within: float, touching: _Index) -> tuple[_Index, _Floats, _Floats]:
        found = _Found(np.full(len(points), -1), np.full(len(points), within**2), np.zeros((len(points), 3)))
        low, high = faces.corners.min(1) - within, faces.corners.max(1) + within
        candidates = _Candidates(faces.corners, faces.areas, faces.components, low, high)
        _search(points, sizes, components, candidates, count, touching, found)
        return found.face, found.weights, np.sqrt(found.squared)

    close, weights, distances = search(contact, np.empty(0, np.int64))
    near = close >= 0
    if not near.any():
        return close, weights, distances
    return search(reach, np.unique(components[near] * count + faces.components[close[near]]))


@kernel
def _search(
    points: _Floats, sizes: _Floats, components: _Index, faces: _Candidates, count: int, touching: _Index, found: _Found
) -> None:
    """Set what is nearest to each point."""
    # `touching` are the sorted pairs of components that count, as a * count + b; all do if it is empty.
    weights, corners = np.empty(3), faces.corners
    for number in range(len(points)):
        p, own = points[number], components[number]
        for other in range(len(corners)):
            if faces.areas[other] <= sizes[number] or faces.components[other] == own:
                continue
            outside = False
            for i in range(3):
                outside = outside or p[i] < faces.low[other, i] or p[i] > faces.high[other, i]
            if outside:
                continue
            squared = nearest_on_triangle(p, corners[other, 0], corners[other, 1], corners[other, 2], weights)
            if squared >= found.squared[number]:
                continue
            if len(touching):
                key = own * count + faces.components[other]
                at = np.searchsorted(touching, key)
                if at == len(touching) or touching[at] != key:
                    continue
            found.squared[number], found.face[number] = squared, other
            for i in range(3):
                found.weights[number, i] = weights[i]
