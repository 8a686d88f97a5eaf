"""Mend a deformed surface where it is broken: around faults, one affine map of the surface at rest takes over.

An affine map neither folds nor cuts what did not. Faulty faces that share a vertex, cut each other or lie in one region
make a region. There the surface y at rest x goes to

    z = (1 - T) y + sum_r w_r A_r x / max(T, 1),    T = min(sum_r w_r, 1),

A_r the affine map nearest to y with weights w_r, and w_r the weights of the neighbourhood of its faulty vertices
(`Surroundings`). A region that stays faulty grows, and regions whose cores meet become one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from meshdeform.exemplar.faults import Faults, Found
from meshdeform.exemplar.invertible import affine_map
from meshdeform.exemplar.measures import vertex_areas
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["Surroundings", "mended_by_regions"]

_RADIUS, _GROWTH = 0.01, 1.2
_ROUNDS = 40
_COVERED = 0.35
"""Share of the area under regions from which it is given up."""
_MARGIN, _CORE = 0.02, 0.5


class Surroundings:
    """What lies around vertices of a surface at rest, (V, 3) float64, whose box has a diagonal.

    A neighbourhood of radius r around vertices has the weights smoothstep(2 - d / r), d the distance to the nearest.
    `masses` (V,) float64 are the areas around the vertices.
    """

    def __init__(self, rest: Floats, faces: Index) -> None:
        self.rest, self.faces, self.masses = rest, faces, vertex_areas(rest, faces)
        used = rest[np.unique(faces)]
        self._low = used.min(0)
        self._diagonal = max(float(np.linalg.norm(np.ptp(used, axis=0))), 1e-300)

    def corners(self, bad: Flags) -> Index:
        """Return the vertices of some of the faces (F,)."""
        return np.unique(self.faces[bad])

    def weights(self, seeds: Index, radius: float) -> tuple[Index, Floats]:
        """Return the vertices (K,) around seeds and their weights (K,); the radius is a share of the diagonal."""
        reach = 2 * radius * self._diagonal
        rows = self._within(seeds, reach)
        distances = cKDTree(self.rest[seeds]).query(self.rest[rows], distance_upper_bound=reach)[0]
        share = np.clip(2 - 2 * distances / reach, 0, 1)
        inside = share > 0
        return rows[inside], share[inside] ** 2 * (3 - 2 * share[inside])

    def _within(self, seeds: Index, reach: float) -> Index:
        """Return the vertices in cells as large as the reach that hold seeds or are beside one."""
        cells = np.floor((self.rest - self._low) / reach).astype(np.int64).clip(-1, 4096)
        shape = cells.max(0) + 3
        if np.prod(shape) > 4 * len(self.rest):
            return np.arange(len(self.rest))
        marked = np.zeros(tuple(shape), bool)
        own = cells[seeds] + 1
        for step in np.ndindex(3, 3, 3):
            marked[tuple((own + step - 1).clip(0, shape - 1).T)] = True
        return np.flatnonzero(marked[tuple((cells + 1).T)])


@dataclass(frozen=True)
class _Region:
    """Faulty vertices, the radius around them, and the weights of vertices there."""

    seeds: Index
    radius: float
    rows: Index
    weights: Floats


def mended_by_regions(base: Found, faults: Faults, around: Surroundings) -> Found | None:
    """Return a shape without folds of which few faces newly cut (`Found.is_clean`); None if it would be another.

    `base`: the shape to mend.
    """
    goal, masses = base.verts, around.masses
    whole = affine_map(around.rest, goal, masses)[:3]
    regions: list[_Region] = []
    found = base
    for _ in range(_ROUNDS):
        if found.is_clean:
            return found
        if found.crowded:
            return None
        regions = _grown(regions, found, around)
        total = np.zeros(len(goal))
        for region in regions:
            total[region.rows] += region.weights
        if masses @ np.minimum(total, 1) > _COVERED * masses.sum():
            return None
        verts = goal * (1 - np.minimum(total, 1))[:, None]
        for region in regions:
            rows, weights = region.rows, region.weights
            if not len(rows):
                return None
            own = affine_map(around.rest[rows], goal[rows], masses[rows] * weights, whole, ridge=1e-3)
            verts[rows] += (weights / np.maximum(total[rows], 1))[:, None] * _mapped(around.rest[rows], own)
        verts[total == 0] = goal[total == 0]
        found = faults.find(verts, found)
    return None


def _mapped(points: Floats, affine: Floats) -> Floats:
    """Return points (N, 3) moved by an affine map (4, 3)."""
    return np.asarray(points @ affine[:3] + affine[3])


def _grown(regions: list[_Region], found: Found, around: Surroundings) -> list[_Region]:
    """Return the regions with new ones around faults outside of all, and those with faults larger."""
    bad = np.flatnonzero(found.to_mend)
    pairs = found.pairs if found.too_many_cut else found.pairs[:0]
    label = _clusters(bad, pairs, regions, around)
    of_region = label[len(bad) :]
    grown = []
    for cluster in np.unique(label):
        inside = [regions[number] for number in np.flatnonzero(of_region == cluster)]
        faces = bad[label[: len(bad)] == cluster]
        if not len(faces):
            grown += inside
            continue
        seeds = np.unique(np.concatenate([around.faces[faces].ravel(), *(region.seeds for region in inside)]))
        radius = max([_RADIUS, *(_GROWTH * region.radius for region in inside)])
        rows, weights = around.weights(seeds, radius)
        grown.append(_Region(seeds, radius, rows[weights > 0], weights[weights > 0]))
    return _united(grown, len(around.rest))


def _clusters(bad: Index, pairs: Index, regions: list[_Region], around: Surroundings) -> Index:
    """Return the cluster of each bad face, then of each region."""
    count, verts = len(bad) + len(regions), len(around.rest)
    row_of = np.full(len(around.faces), -1)
    row_of[bad] = np.arange(len(bad))
    nodes, members = [np.repeat(np.arange(len(bad)), 3)], [around.faces[bad].ravel()]
    for number, region in enumerate(regions):
        rows = region.rows[region.weights > _MARGIN]
        nodes.append(np.full(len(rows), len(bad) + number))
        members.append(rows)
    node, member = np.concatenate(nodes), np.concatenate(members) + count
    # A graph of faces and regions with the vertices that they hold.
    ends = (np.concatenate([node, row_of[pairs[:, 0]]]), np.concatenate([member, row_of[pairs[:, 1]]]))
    graph = sparse.coo_matrix((np.ones(len(ends[0]), bool), ends), shape=(count + verts,) * 2)
    return np.asarray(csgraph.connected_components(graph, directed=False)[1][:count], np.int64)


def _united(regions: list[_Region], verts: int) -> list[_Region]:
    """Return the regions, those whose cores meet as one."""
    while len(regions) > 1:
        cores = [region.rows[region.weights > _CORE] for region in regions]
        owner = np.repeat(np.arange(len(regions)), [len(core) for core in cores])
        member = np.concatenate(cores) + len(regions)
        graph = sparse.coo_matrix((np.ones(len(owner), bool), (owner, member)), shape=(len(regions) + verts,) * 2)
        label = csgraph.connected_components(graph, directed=False)[1][: len(regions)]
        groups = [np.flatnonzero(label == number) for number in np.unique(label)]
        if len(groups) == len(regions):
            break
        regions = [_union([regions[number] for number in group]) for group in groups]
    return regions


def _union(regions: list[_Region]) -> _Region:
    """Return regions as one, which has the largest radius, and of each vertex the largest weight."""
    rows, row_of = np.unique(np.concatenate([region.rows for region in regions]), return_inverse=True)
    weights = np.zeros(len(rows))
    np.maximum.at(weights, row_of, np.concatenate([region.weights for region in regions]))
    seeds = np.unique(np.concatenate([region.seeds for region in regions]))
    return _Region(seeds, max(region.radius for region in regions), rows, weights)
