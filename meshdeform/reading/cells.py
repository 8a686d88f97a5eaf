"""The faces of an asset as cells with areas, normals and neighbours; of a large mesh, groups of near faces.

Up to `MOST_CELLS` faces, each is a cell. Of more, faces of one component and one cell of a grid that face the same
way (the largest of six) are one; the grid is as fine as that number allows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.nouns.deformed import Part
from meshdeform.nouns.labels import Flags, Floats, Index, solids_of
from meshdeform.reading.samples import area_vectors

__all__ = ["MOST_CELLS", "Cells", "cells_of", "connected", "ground_plate", "neighbouring_faces"]

MOST_CELLS = 30_000
_COARSEST = 0.2
_FLAT, _BROAD, _ABOVE_GROUND = 0.04, 0.7, 0.05
_WIDER, _LEAST_HEIGHT = 0.75, 0.6
_MOST_PLATES = 400


@dataclass(frozen=True)
class Cells:
    """C cells of F faces.

    `of_face` (F,) int64; `face` (C,) int64 is the largest face of each; `areas` (C,), `centres` and `normals` (C, 3)
    float64; `components` (C,) int64. Neighbours: `links` (E, 2) int64 and the length (E,) of the edge between them.
    """

    of_face: Index
    face: Index
    areas: Floats
    centres: Floats
    normals: Floats
    components: Index
    links: Index
    lengths: Floats

    def __len__(self) -> int:
        return len(self.areas)

    def mean(self, values: Floats, face_areas: Floats) -> Floats:
        """Return values (F,) of faces as means (C,) of the cells."""
        total = np.bincount(self.of_face, face_areas, len(self))
        return np.asarray(np.bincount(self.of_face, face_areas * values, len(self)) / np.maximum(total, 1e-300))


def cells_of(verts: Floats, faces: Index) -> Cells:
    """Return the cells of a mesh whose box has a diagonal of about 1."""
    crosses = area_vectors(verts, faces)
    areas = np.linalg.norm(crosses, axis=1) / 2
    centres = verts[faces].mean(1)
    components = solids_of(Part(verts, faces))[faces[:, 0]]
    of_face = _clusters(centres, crosses, components, float(areas.sum()))
    count = int(of_face.max()) + 1
    order = np.lexsort([-areas, of_face])
    largest = order[np.unique(of_face[order], return_index=True)[1]]
    total = np.maximum(np.bincount(of_face, areas, count), 1e-12)
    mean = np.stack([np.bincount(of_face, crosses[:, axis], count) for axis in range(3)], 1)
    normals = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-30)
    links, lengths = _links(verts, faces, of_face)
    return Cells(of_face, largest, total, centres[largest], normals, components[largest], links, lengths)


def _clusters(centres: Floats, crosses: Floats, components: Index, area: float) -> Index:
    """Return the cell (F,) of each face."""
    if len(centres) <= MOST_CELLS:
        return np.arange(len(centres))
    axis = np.abs(crosses).argmax(1)
    facing = axis * 2 + (np.take_along_axis(crosses, axis[:, None], 1)[:, 0] > 0)
    side = np.sqrt(area / MOST_CELLS)
    while True:
        grid = np.floor((centres - centres.min(0)) / side).astype(np.int64)
        cell = np.ravel_multi_index(tuple(grid.T), tuple(grid.max(0) + 1))
        key = (components * (int(cell.max()) + 1) + cell) * 6 + facing
        number = np.unique(key, return_inverse=True)[1]
        if number.max() < MOST_CELLS or side > _COARSEST:
            return np.asarray(number, np.int64)
        side *= 1.25


def _links(verts: Floats, faces: Index, of_face: Index) -> tuple[Index, Floats]:
    """Return the pairs (E, 2) of neighbouring cells and the lengths (E,) of the edges between them."""
    neighbours, edge = neighbouring_faces(faces, len(verts))
    pairs = np.sort(of_face[neighbours], 1)
    length = np.linalg.norm(verts[edge[:, 0]] - verts[edge[:, 1]], axis=1)
    across = pairs[:, 0] != pairs[:, 1]
    count = int(of_face.max()) + 1
    number, where = np.unique(pairs[across, 0] * count + pairs[across, 1], return_inverse=True)
    joined = np.bincount(where, length[across], len(number)).astype(float)
    return np.asarray(np.stack([number // count, number % count], 1), np.int64), joined


def neighbouring_faces(faces: Index, verts: int) -> tuple[Index, Index]:
    """Return the pairs (E, 2) of faces that share an edge, and the edges (E, 2), of a mesh of so many vertices.

    Of more than two faces at one edge, each is a pair with the next.
    """
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
    owner = np.tile(np.arange(len(faces)), 3)
    key = edges[:, 0] * verts + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(np.diff(key[order]) == 0)
    return np.stack([owner[order[same]], owner[order[same + 1]]], 1), edges[order[same]]


def ground_plate(verts: Floats, faces: Index) -> Flags:
    """Return the faces (F,) of a flat plate on which an asset stands, wider than the rest: it is none of the asset."""
    components = solids_of(Part(verts, faces))
    used = np.zeros(len(verts), bool)
    used[faces] = True
    low, high = verts[used].min(0), verts[used].max(0)
    size, flat = high - low, np.zeros(len(verts), bool)
    numbers, counts = np.unique(components[used], return_counts=True)
    for number in numbers[np.argsort(-counts)][:_MOST_PLATES]:
        own = components == number
        extent, top = np.ptp(verts[own], axis=0), verts[own, 1].max()
        broad = min(extent[0], extent[2]) > _BROAD * max(size[0], size[2])
        thin = extent[1] < _FLAT * np.linalg.norm(size) and top < low[1] + _ABOVE_GROUND * size[1]
        if broad and thin:
            flat |= own
    rest = used & ~flat
    if not flat.any() or not rest.any():
        return np.zeros(len(faces), bool)
    standing = np.ptp(verts[rest], axis=0)
    wider = max(standing[0], standing[2]) < _WIDER * max(size[0], size[2])
    return flat[faces[:, 0]] if wider and standing[1] > _LEAST_HEIGHT * size[1] else np.zeros(len(faces), bool)


def connected(count: int, pairs: Index) -> Index:
    """Return the number (C,) of the connected group of each of `count` things, by the pairs (P, 2) that are joined."""
    graph = sparse.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], np.int64)
