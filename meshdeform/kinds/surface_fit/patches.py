"""Divide base triangles into smaller ones, one patch per face or all of them as one mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.edge_splits import unique_edges

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class Level:
    """A uniform subdivision of the base: every edge in `2^k` parts."""

    corners: _Index  # (P, 3) int64: of the base face in which each vertex lies
    weights: _Floats  # (P, 3) float64: its barycentric coordinates there
    faces: _Index  # (F 4^k, 3) int64


def patch(parts: int) -> tuple[_Floats, _Index]:
    """Return barycentric coordinates (P, 3) and triangles (parts^2, 3) of one triangle with edges in `parts` parts."""
    rows = [(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    number = {place: index for index, place in enumerate(rows)}
    weights = np.array([((parts - i - j) / parts, i / parts, j / parts) for i, j in rows])
    upward = [[(i, j), (i + 1, j), (i, j + 1)] for i, j in rows if i + j < parts]
    downward = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in rows if i + j < parts - 1]
    return weights, np.array([[number[place] for place in face] for face in upward + downward], np.int64)


def level_of(faces: _Index, vertices: int, level: int) -> Level:
    """Return the subdivision of a base whose edges have different ends: its vertices, of edges, then of faces."""
    parts = 2**level
    edges, which = unique_edges(faces)
    inner = parts - 1
    weights, small = patch(parts)
    grid = np.rint(weights * parts).astype(int)
    interior = (grid > 0).all(1)
    per_face = int(interior.sum())
    table = np.empty((len(faces), len(weights)), np.int64)
    for k in range(3):
        table[:, grid[:, k] == parts] = faces[:, [k]]
        # Points on edge k run from corner k to corner k + 1; on the edge they are counted from its smaller vertex.
        on = (grid[:, (k + 2) % 3] == 0) & (grid[:, k] > 0) & (grid[:, (k + 1) % 3] > 0)
        along = grid[on][:, (k + 1) % 3]
        forward = (faces[:, k] < faces[:, (k + 1) % 3])[:, None]
        table[:, on] = vertices + which[:, [k]] * inner + np.where(forward, along, parts - along) - 1
    begin = vertices + len(edges) * inner
    table[:, interior] = begin + np.arange(len(faces) * per_face).reshape(len(faces), per_face)
    count = begin + len(faces) * per_face
    corners, coordinates = np.empty((count, 3), np.int64), np.empty((count, 3))
    corners[table.ravel()] = np.repeat(faces, len(weights), 0)
    coordinates[table.ravel()] = np.tile(weights, (len(faces), 1))
    return Level(corners, coordinates, table[:, small].reshape(-1, 3))


def divided(verts: _Floats, faces: _Index, fewest: int) -> tuple[_Floats, _Index]:
    """Return the same flat faces (F, 3) and vertices (V, 3), divided evenly into at least `fewest`."""
    if len(faces) >= fewest:
        return verts, faces
    level = level_of(faces, len(verts), math.ceil(math.log(fewest / len(faces), 4)))
    return np.einsum("pk,pkc->pc", level.weights, verts[level.corners]), level.faces
