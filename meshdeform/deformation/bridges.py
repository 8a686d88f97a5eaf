"""Connect the components of an asset, so that a path carries them together.

A Poisson solve places every connected component separately. Bridges are short lines between points of different
components: the edges of the Delaunay tetrahedra of points on the whole surface. Each has its own map along the path,
which turns with the surface at its ends, and the components are placed where the bridges fit best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import Delaunay

from meshdeform.geometry.mesh import RestMesh

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_POINTS, _FEWEST, _MOST = 4000, 16, 40_000
_JITTER = 1e-4
_SOFTENING = 0.01
"""Length, relative to the diagonal, below which bridges no longer gain weight by being shorter."""


@dataclass(frozen=True)
class Bridges:
    """Lines between points of different components."""

    faces: _Index  # (B, 2) int64: the faces on which each bridge begins and ends
    components: _Index  # (B, 2) int64: their components, of `RestMesh.joined`
    # sparse (B, V): weights of the vertices that give the end points
    begins: sparse.csr_matrix
    ends: sparse.csr_matrix
    weights: _Floats  # (B,) float64: larger for shorter bridges

    @classmethod
    def of(cls, rest: RestMesh) -> Bridges:
        """Return the bridges of a mesh: none if it is connected. The same mesh always has the same ones."""
        faces, verts = rest.faces, rest.verts
        of_face = rest.components[faces[:, 0]]
        if (of_face == of_face[0]).all():
            return cls._between(
                rest, np.empty((0, 2), np.int64), np.empty(0, np.int64), sparse.csr_matrix((0, len(verts)))
            )
        random = np.random.default_rng(0)
        face = _chosen_faces(rest, of_face, random)
        points = _on_faces(faces[face], len(verts), random)
        positions = points @ verts
        size = float(np.linalg.norm(np.ptp(positions, axis=0)))
        # Points in one plane have no tetrahedra.
        tetrahedra = Delaunay(positions + random.normal(0, _JITTER * size, positions.shape)).simplices
        pairs = np.concatenate([tetrahedra[:, [i, j]] for i in range(4) for j in range(i)])
        pairs = pairs[of_face[face[pairs[:, 0]]] != of_face[face[pairs[:, 1]]]]
        return cls._between(rest, np.unique(np.sort(pairs, 1), axis=0).astype(np.int64), face, points)

    @classmethod
    def _between(cls, rest: RestMesh, pairs: _Index, face: _Index, points: sparse.csr_matrix) -> Bridges:
        of_face = rest.joined[rest.faces[:, 0]]
        begins, ends = points[pairs[:, 0]], points[pairs[:, 1]]
        verts = rest.verts
        length = np.linalg.norm((ends - begins) @ verts, axis=1)
        soft = _SOFTENING * float(np.linalg.norm(np.ptp(verts, axis=0)))
        owners = face[pairs]
        return cls(owners, of_face[owners], begins, ends, 1 / (length**2 + soft**2))

    def __len__(self) -> int:
        return len(self.faces)

    def lines(self, verts: _Floats) -> _Floats:
        """Return the vectors (B, 3) from the beginnings to the ends."""
        return np.asarray(self.ends @ verts - self.begins @ verts)

    def pairs(self, count: int) -> sparse.coo_matrix:
        """Return the pairs of faces (F, F) that are joined, one for each."""
        first, second = np.unique(np.sort(self.faces, 1), axis=0).T
        return sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))


class ComponentShifts:
    """Translations of components that fit the bridges best.

    `count`: number of components. Those without a bridge, and one of each connected group, do not move. `groups`, (C,)
    int64: the group of components, connected by bridges, to which each belongs.
    """

    def __init__(self, bridges: Bridges, count: int) -> None:
        number = len(bridges)
        rows = np.repeat(np.arange(number), 2)
        self._difference = sparse.csr_matrix(
            (np.tile([-1.0, 1.0], number), (rows, bridges.components.ravel())), shape=(number, count)
        )
        self._weighted = (self._difference.T @ sparse.diags(bridges.weights)).tocsr()
        laplacian = (self._weighted @ self._difference).tocsc()
        _, self.groups = sparse.csgraph.connected_components(laplacian, directed=False)
        self._free = np.ones(count, bool)
        self._free[np.unique(self.groups, return_index=True)[1]] = False
        free = np.flatnonzero(self._free)
        self._factor = splu(laplacian[free][:, free]) if len(free) else None
        self._count = count

    def translations(self, missing: _Floats) -> _Floats:
        """Return the translations (C, 3) for what is missing of each bridge (B, 3): its goal less what it is."""
        moved = np.zeros((self._count, 3))
        if self._factor is not None:
            moved[self._free] = self._factor.solve((self._weighted @ missing)[self._free])
        return moved


def _chosen_faces(rest: RestMesh, of_face: _Index, random: np.random.Generator) -> _Index:
    """Return faces for points on all components: in proportion to the area, and some on each."""
    areas = rest.areas
    total = np.bincount(of_face, areas)
    components = np.unique(of_face)
    fewest = max(1, min(_FEWEST, _MOST // len(components)))
    counts = np.maximum(fewest, np.rint(_POINTS * total[components] / max(total.sum(), np.finfo(float).tiny)))
    order = np.argsort(of_face, kind="stable")
    bounds = np.searchsorted(of_face[order], components), np.searchsorted(of_face[order], components, "right")
    chosen = []
    for begin, end, number in zip(*bounds, counts.astype(int), strict=True):
        own = order[begin:end]
        share = areas[own] / areas[own].sum() if areas[own].sum() > 0 else np.full(len(own), 1 / len(own))
        chosen.append(random.choice(own, number, p=share))
    return np.concatenate(chosen)


def _on_faces(corners: _Index, count: int, random: np.random.Generator) -> sparse.csr_matrix:
    """Return weights (P, V) of a random point on each of the faces (P, 3)."""
    root, along = np.sqrt(random.random(len(corners))), random.random(len(corners))
    weights = np.stack([1 - root, root * (1 - along), root * along], 1)
    return sparse.csr_matrix(
        (weights.ravel(), corners.ravel(), np.arange(len(corners) + 1) * 3), shape=(len(corners), count)
    )
