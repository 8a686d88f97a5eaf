"""Let the vertices of slivers follow what they lie on.

The tip v of a sliver lies nearly on its longest edge, from a to b. A map that bends that edge moves v off its chord by
more than the sliver is high, and turns it over. With the weights of v, at rest, in the triangle of a, b and the far
corner c of the face behind v, its displacement becomes

    d_v = w_a d_a + w_b d_b + w_c d_c

which is what an affine map would do, and leaves the sliver as flat and as high as it was.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["along_slivers"]

_Floats = NDArray[np.float64]
_THIN = 0.02
"""Height of a sliver, as a share of its longest edge."""
_BESIDE = 0.05
"""Weight of the far corner up to which a tip lies on its edge."""


def along_slivers(rest: _Floats, faces: NDArray[np.int64], moved: _Floats) -> _Floats:
    """Return the vertices (V, 3) of a deformed mesh with the tips of slivers where those of their edges have gone.

    `rest`, (V, 3) float64: the vertices before; a tip of which another vertex depends, or with none behind it, stays
    where it was moved to.
    """
    corners = rest[faces]
    edges = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2)  # of each corner to the next
    longest = edges.argmax(1)
    rows = np.arange(len(faces))
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    thin = np.flatnonzero(area < _THIN * edges[rows, longest] ** 2)
    if not len(thin):
        return moved
    a, b, tip = (faces[thin, (longest[thin] + step) % 3] for step in range(3))
    far = _behind(faces, thin, a, b, tip)
    known = far >= 0
    weights = np.zeros((len(thin), 3))
    weights[known] = _weights(rest[a[known]], rest[b[known]], rest[far[known]], rest[tip[known]])
    usable = known & (weights[:, :2] >= 0.0).all(1) & (np.abs(weights[:, 2]) < _BESIDE)
    usable &= ~np.isin(np.stack([a, b, np.maximum(far, 0)], 1), tip[usable]).any(1)
    a, b, tip, far = (each[usable] for each in (a, b, tip, far))
    shift = moved - rest
    followed = moved.copy()
    followed[tip] = rest[tip] + np.einsum("nk,nki->ni", weights[usable], np.stack([shift[a], shift[b], shift[far]], 1))
    return followed


def _behind(
    faces: NDArray[np.int64],
    thin: NDArray[np.int64],
    a: NDArray[np.int64],
    b: NDArray[np.int64],
    tip: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return the far corner of a face that has the tip and one end of a sliver's edge, but not both; -1: none."""
    is_thin = np.zeros(len(faces), bool)
    is_thin[thin] = True
    count = int(faces.max()) + 1
    others = faces[~is_thin]
    sides = np.concatenate([others[:, [0, 1]], others[:, [1, 2]], others[:, [2, 0]]])
    keys = np.sort(sides, axis=1) @ np.array([count, 1])
    opposite = np.concatenate([others[:, 2], others[:, 0], others[:, 1]])
    order = np.argsort(keys, kind="stable")
    keys, opposite = keys[order], opposite[order]
    far = np.full(len(tip), -1)
    for end in (a, b):
        wanted = np.minimum(end, tip) * count + np.maximum(end, tip)
        at = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        if len(keys):
            far = np.where((far < 0) & (keys[at] == wanted), opposite[at], far)
    return far


def _weights(a: _Floats, b: _Floats, c: _Floats, point: _Floats) -> _Floats:
    """Return the barycentric coordinates (N, 3) of points in triangles, projected onto their planes."""
    u, v, w = b - a, c - a, point - a
    uu, uv, vv, wu, wv = (np.einsum("ni,ni->n", x, y) for x, y in ((u, u), (u, v), (v, v), (w, u), (w, v)))
    area = uu * vv - uv**2
    safe = np.where(area > 0.0, area, 1.0)
    beta, gamma = (vv * wu - uv * wv) / safe, (uu * wv - uv * wu) / safe
    return np.where((area > 0.0)[:, None], np.stack([1.0 - beta - gamma, beta, gamma], 1), -1.0)
