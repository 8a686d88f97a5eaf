"""Self-intersections of a triangle mesh: how many faces cut through another.

Bounding boxes are swept along the longest axis; the pairs that overlap are tested exactly as two triangles: does an
edge of one cross the inside of the other. Faces that share an edge cannot cross elsewhere unless they are folded flat,
and are not tested; faces that share one vertex are tested with the edges opposite to it. Touching and coplanar
overlap do not count.

Source of the segment test: Möller and Trumbore 1997, Fast, Minimum Storage Ray-Triangle Intersection.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["intersecting_faces"]

_EPSILON = 1e-9


@numba.njit(cache=True, nogil=True)
def _segment_cuts(p, q, a, b, c):  # type: ignore[no-untyped-def]
    """Whether the open segment p q crosses the inside of the triangle a b c."""
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    h0, h1, h2 = d1 * v2 - d2 * v1, d2 * v0 - d0 * v2, d0 * v1 - d1 * v0
    det = u0 * h0 + u1 * h1 + u2 * h2
    size = (d0 * d0 + d1 * d1 + d2 * d2) * (u0 * u0 + u1 * u1 + u2 * u2) * (v0 * v0 + v1 * v1 + v2 * v2)
    if det * det <= 1e-24 * size:
        return False
    inv = 1.0 / det
    s0, s1, s2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    u = (s0 * h0 + s1 * h1 + s2 * h2) * inv
    if u <= _EPSILON or u >= 1.0 - _EPSILON:
        return False
    k0, k1, k2 = s1 * u2 - s2 * u1, s2 * u0 - s0 * u2, s0 * u1 - s1 * u0
    v = (d0 * k0 + d1 * k1 + d2 * k2) * inv
    if v <= _EPSILON or u + v >= 1.0 - _EPSILON:
        return False
    t = (v0 * k0 + v1 * k1 + v2 * k2) * inv
    return _EPSILON < t < 1.0 - _EPSILON


@numba.njit(cache=True, nogil=True)
def _pair_cuts(verts, f, g):  # type: ignore[no-untyped-def]
    shared = 0
    at_f = -1
    at_g = -1
    for i in range(3):
        for j in range(3):
            if f[i] == g[j]:
                shared += 1
                at_f = i
                at_g = j
    if shared >= 2:
        return False
    for i in range(3):
        # With one common vertex only the opposite edge can cross properly.
        if shared == 0 or i == at_f:
            p, q = verts[f[(i + 1) % 3]], verts[f[(i + 2) % 3]]
            if _segment_cuts(p, q, verts[g[0]], verts[g[1]], verts[g[2]]):
                return True
        if shared == 0 or i == at_g:
            p, q = verts[g[(i + 1) % 3]], verts[g[(i + 2) % 3]]
            if _segment_cuts(p, q, verts[f[0]], verts[f[1]], verts[f[2]]):
                return True
    return False


@numba.njit(cache=True, nogil=True)
def _sweep(verts, faces, low, high, order, first, second, hit):  # type: ignore[no-untyped-def]
    n = len(order)
    for i in range(n):
        f = order[i]
        for j in range(i + 1, n):
            g = order[j]
            if low[g, first] > high[f, first]:
                break
            if hit[f] and hit[g]:
                continue
            if low[g, second] > high[f, second] or high[g, second] < low[f, second]:
                continue
            third = 3 - first - second
            if low[g, third] > high[f, third] or high[g, third] < low[f, third]:
                continue
            if _pair_cuts(verts, faces[f], faces[g]):
                hit[f] = True
                hit[g] = True


def intersecting_faces(verts: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which faces cut through another face of the mesh.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64

    Returns
    -------
    (F,) bool
    """
    hit = np.zeros(len(faces), np.bool_)
    if len(faces) < 2:
        return hit
    corners = verts[faces]
    low, high = corners.min(1), corners.max(1)
    axes = np.argsort(-(high.max(0) - low.min(0)))
    order = np.argsort(low[:, axes[0]], kind="stable")
    _sweep(verts, faces, low, high, order, int(axes[0]), int(axes[1]), hit)
    return hit
