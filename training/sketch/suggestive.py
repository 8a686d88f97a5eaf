"""Find suggestive contours (DeCarlo, Finkelstein, Rusinkiewicz, Santella 2003) on the smooth parts of a mesh.

They lie where the curvature in the direction of the view, the radial curvature, is zero and grows towards the eye:
there an outline would begin, if the eye moved a little. Curvature is that of the vertex normals (Rusinkiewicz 2004), so
facets of a smooth body do not count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.kinds.sketch.solids import Floats

_SMOOTH_COS = 0.95
"""Cosine of the angle between the normals of a vertex and its faces from which on the surface is smooth there."""
_FACING_COS = 0.87
"""Cosine of the angle to the view above which a place faces the eye; contours are unstable there."""
_GROWTH = 0.02
"""Least growth of the radial curvature towards the eye, times the square of the size of the whole."""


def suggestive_contours(verts: Floats, faces: NDArray[np.int64], eye: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return points (P, 3) and segments (S, 2) between them, of a mesh of shared vertices and an eye outside it."""
    corners = verts[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    flat = across / np.maximum(area, 1e-12)[:, None]
    normals = _summed(np.repeat(across, 3, 0), faces, len(verts))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    rough = np.zeros(len(verts), bool)
    rough[faces[np.einsum("fki,fi->fk", normals[faces], flat) < _SMOOTH_COS]] = True
    shape = _summed(np.repeat(_shapes(corners, normals[faces], flat) * area[:, None, None], 3, 0), faces, len(verts))
    shape /= np.maximum(_summed(np.repeat(area, 3), faces, len(verts)), 1e-12)[:, None, None]

    view = eye - verts
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    facing = np.einsum("vi,vi->v", normals, view)
    toward = view - facing[:, None] * normals
    radial = np.einsum("vi,vij,vj->v", toward, shape, toward) / np.maximum((toward**2).sum(1), 1e-9)
    usable = ~rough[faces].any(1) & ((facing > 0) & (facing < _FACING_COS))[faces].all(1)
    values = radial[faces]
    usable &= (values.min(1) < 0) & (values.max(1) > 0)

    segments = []
    size = float(np.ptp(verts, axis=0).max())
    for face in np.flatnonzero(usable):
        gradient = _gradient(corners[face], values[face], flat[face])
        if gradient @ toward[faces[face]].mean(0) * size**2 < _GROWTH * size:
            continue
        ends = []
        for i, j in ((0, 1), (1, 2), (2, 0)):
            a, b = values[face, i], values[face, j]
            if (a < 0) != (b < 0):
                ends.append(corners[face, i] + a / (a - b) * (corners[face, j] - corners[face, i]))
        segments.append(np.stack(ends))
    points = np.concatenate(segments) if segments else np.zeros((0, 3))
    _, first, same = np.unique(np.round(points / size, 9), axis=0, return_index=True, return_inverse=True)
    return points[first], same.reshape(-1, 2)


def _summed(rows: Floats, faces: NDArray[np.int64], count: int) -> Floats:
    """Return the sums of rows (3 F, ...) of the faces' corners at each vertex."""
    result = np.zeros((count, *rows.shape[1:]))
    np.add.at(result, faces.reshape(-1), rows)
    return result


def _shapes(corners: Floats, normals: Floats, flat: Floats) -> Floats:
    """Return the shape operator of each face (F, 3, 3) by the differences of its normals along its edges."""
    edges = np.roll(corners, -1, 1) - corners
    turns = np.roll(normals, -1, 1) - normals
    u = edges[:, 0] / np.maximum(np.linalg.norm(edges[:, 0], axis=1, keepdims=True), 1e-12)
    frame = np.stack([u, np.cross(flat, u)], 1)  # (F, 2, 3)
    e, n = edges @ frame.mT, turns @ frame.mT  # (F, 3, 2)
    # e (3, 2) @ S = n with S symmetric: rows (e0, e1, 0) and (0, e0, e1) for its three entries.
    zero = np.zeros_like(e[..., :1])
    system = np.concatenate([np.concatenate([e, zero], -1), np.concatenate([zero, e], -1)], 1)
    goal = np.concatenate([n[..., 0], n[..., 1]], 1)
    square = system.mT @ system + 1e-12 * np.eye(3)
    s = np.linalg.solve(square, system.mT @ goal[..., None])[..., 0]
    small = np.stack([s[:, [0, 1]], s[:, [1, 2]]], 1)
    return np.asarray(frame.mT @ small @ frame)


def _gradient(corners: Floats, values: Floats, flat: Floats) -> Floats:
    """Return the gradient of values at the corners of a triangle."""
    sides = np.stack([corners[2] - corners[1], corners[0] - corners[2], corners[1] - corners[0]])
    twice = float(np.linalg.norm(np.cross(sides[2], -sides[1])))
    return np.asarray((values[:, None] * np.cross(flat, sides)).sum(0) / twice)
