"""Convert triangle lists, strips and fans to triangle lists.

Source: glTF 2.0 specification, section 3.7.2.1, which defines the windings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.scenegraph import TRIANGLE_FAN, TRIANGLE_STRIP

__all__ = ["triangle_list"]


def triangle_list(corners: NDArray[np.int64], mode: int, restart: int | None = None) -> NDArray[np.int64]:
    """Return the triangles that a primitive's corners form.

    Parameters
    ----------
    corners : (C,) int64
        Vertex indices in drawing order.
    mode : int
        4 triangles, 5 strip, 6 fan.
    restart : int, optional
        The index that starts a new strip or fan (glTF forbids it, but some exporters write it).

    Returns
    -------
    (T, 3) int64. Triangles with a repeated corner are removed from strips and fans, where they only join parts, but
    not from lists. Corners past the last whole triangle are ignored.
    """
    if mode not in (TRIANGLE_STRIP, TRIANGLE_FAN):
        return np.asarray(corners[: len(corners) // 3 * 3].reshape(-1, 3))
    cuts = np.flatnonzero(corners == restart) if restart is not None else np.empty(0, np.int64)
    make = _strip if mode == TRIANGLE_STRIP else _fan
    parts = [make(part[part != restart]) for part in np.split(corners, cuts)]
    triangles = np.concatenate(parts)
    a, b, c = triangles.T
    return np.asarray(triangles[(a != b) & (b != c) & (c != a)])


def _strip(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    if len(corners) < 3:
        return np.empty((0, 3), np.int64)
    triangles = np.lib.stride_tricks.sliding_window_view(corners, 3).copy()
    triangles[1::2] = triangles[1::2][:, [0, 2, 1]]  # every second triangle has the opposite winding
    return triangles


def _fan(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    if len(corners) < 3:
        return np.empty((0, 3), np.int64)
    hub = np.full(len(corners) - 2, corners[0])
    return np.stack([corners[1:-1], corners[2:], hub], axis=1)
