"""Find the shapes between a rest mesh and a result, and beyond it, by interpolating Jacobians.

With J = R S the Jacobian of a face from rest to result (R a rotation, S symmetric) and w = log R::

    J(t) = exp(t w) ((1 - t) I + t S)        v(t) = poisson(J(t))

so a limb that turns keeps its length on the way, which on straight lines of vertices it does not. w is chosen so that
neighbouring faces agree. For t > 1, an eigenvalue s < 1 of S becomes s^t, which never reaches zero.

The solve gives each component its shape, up to a translation. Components are placed by the bridges between them,
which turn and stretch in the same way, and the whole so that what both ends have in the same place
stays there. The ends are exact: t = 0 is the rest mesh and t = 1 the result, bit for bit.

Sources: Sumner et al. 2005, Mesh-Based Inverse Kinematics (rotations interpolated by their logarithms, the rest
linearly); Xu et al. 2006, Poisson Shape Interpolation.

Find rotation vectors of Jacobians, of which neighbours agree.

The rotation R of a Jacobian J = R S (S symmetric) has many logarithms: about the axis n by theta + 2 pi k for every
integer k. Taken alone, two neighbours that are turned by slightly less and slightly more than pi would turn in opposite
directions. So each takes the logarithm nearest to that of a neighbour, from the least rotated one outwards along the
pairs that differ least (phase unwrapping along a minimum spanning tree).

Connect the components of an asset, so that a path carries them together.

A Poisson solve places every connected component separately. Bridges are short lines between points of different
components: the edges of the Delaunay tetrahedra of points on the whole surface. Each has its own map along the path,
which turns with the surface at its ends, and the components are placed where the bridges fit best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.sparse.linalg import splu
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from meshdeform.deformation.poisson import PoissonSystem, completed_jacobians, jacobians_from_verts
from meshdeform.errors import ShapeError
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import RestMesh, TriangleMesh

_STILL = 0.05
"""Displacement, relative to the diagonal, from which vertices hardly count as staying in place."""

_BETWEEN_COMPONENTS = 2.0

_MOST_AROUND = 100
"""Faces around a vertex of which all pairs are listed."""

_Floats = NDArray[np.float64]
_FLAT = 1e-4
"""Second singular value, relative to the first, below which a Jacobian does not determine a rotation."""
_UNCERTAIN = 10.0
"""Length of a pair one of whose members has no rotation of its own; longer than any angle."""
_SHORTEST = 1e-3
_FULL_TURN = 2 * math.pi
_Flags = NDArray[np.bool_]
_Index = NDArray[np.int64]
_POINTS, _FEWEST, _MOST = 4000, 16, 40_000
_JITTER = 1e-4
_SOFTENING = 0.01
"""Length, relative to the diagonal, below which bridges no longer gain weight by being shorter."""


class ShapePath:
    """The way from a mesh at rest to a result. The system is factored once, and each shape costs one solve.

    Parameters
    ----------
    mesh : TriangleMesh
        At rest.
    result : (V, 3) float64
        Vertices of the result, object units.

    Raises
    ------
    ShapeError
        The result has another number of vertices.
    NumericalError
        The system cannot be factored.
    """

    def __init__(self, mesh: TriangleMesh, result: _Floats) -> None:
        if result.shape != mesh.verts.shape:
            raise ShapeError(f"expected verts {mesh.verts.shape}, got {result.shape}")
        self._poisson = PoissonSystem(mesh)
        self._rest = rest = self._poisson.rest
        self._result = result.astype(np.float64)
        self._bridges = Bridges.of(rest)
        self._placement = ComponentShifts(self._bridges, int(rest.joined.max()) + 1)
        self._used = np.bincount(rest.faces.ravel(), minlength=len(rest.verts)) > 0
        self._labels = rest.joined
        jacobians = _jacobians(rest, self._result)
        self._vectors = rotation_vectors(jacobians, rest.solid, self._pairs())
        self._stretch = rotation_matrices(self._vectors).transpose(0, 2, 1) @ jacobians
        sides = self._bridges.faces
        self._turns = self._vectors[sides].mean(1) if len(sides) else np.empty((0, 3))
        ends = [self._bridges.lines(verts) for verts in (rest.verts, self._result)]
        self._lines = ends[0], _turned(-self._turns, ends[1])
        self._stillness = self._weights()
        self._missing = self._result - self._solved(1.0)

    def at(self, share: float) -> _Floats:
        """Return the vertices (V, 3) float64 at a share of the way: 0 is at rest, 1 the result, more exaggerates."""
        if share == 0:
            return self._rest.verts.copy()
        if share == 1:
            return self._result.copy()
        return np.asarray(self._solved(share) + share * self._missing)

    def _solved(self, share: float) -> _Floats:
        jacobians = rotation_matrices(share * self._vectors) @ _stretched(self._stretch, share)
        verts = self._poisson.solve(jacobians)
        begin, end = self._lines
        goal = _turned(share * self._turns, (1 - share) * begin + share * end)
        verts = verts + self._placement.translations(goal - self._bridges.lines(verts))[self._labels]
        groups = self._placement.groups[self._labels]
        straight = (1 - share) * self._rest.verts + share * self._result
        placed: _Floats = verts + _group_means(self._stillness, straight - verts, groups)[groups]
        return placed

    def _pairs(self) -> sparse.csr_matrix:
        """Return the pairs of faces that should agree: neighbours, and those that a bridge joins."""
        rest = self._rest
        neighbours = rest.edge_adjacency
        used = np.unique(rest.components[rest.faces[:, 0]])
        if sparse.csgraph.connected_components(neighbours, directed=False)[0] > len(used):
            neighbours = _around_vertices(rest)
        joined = _BETWEEN_COMPONENTS * self._bridges.pairs(len(rest.faces))
        return (sparse.triu(neighbours, 1) + joined).tocsr()

    def _weights(self) -> _Floats:
        """Return the weights (V,) of vertices, larger for those that the two ends have in the same place."""
        rest = self._rest.verts
        moved = np.linalg.norm(self._result - rest, axis=1)
        still = _STILL * float(np.linalg.norm(np.ptp(rest, axis=0)))
        areas = self._rest.vertex_areas
        areas = np.where(areas > 0, areas, 1e-9 * max(float(areas.max()), np.finfo(float).tiny))
        weights: _Floats = areas / (moved**2 + max(still**2, np.finfo(float).tiny))
        return weights


def _around_vertices(rest: RestMesh) -> sparse.csr_matrix:
    """Return the pairs of faces that share a vertex; around one of very many faces, each with the next one only."""
    incidence = rest.incidence
    crowded = np.bincount(rest.faces.ravel(), minlength=incidence.shape[1]) > _MOST_AROUND
    few = incidence[:, np.flatnonzero(~crowded)]
    vertex, face = incidence[:, np.flatnonzero(crowded)].T.nonzero()
    chained = vertex[1:] == vertex[:-1]
    chain = sparse.csr_matrix((chained.astype(np.float64), (face[:-1], face[1:])), shape=(incidence.shape[0],) * 2)
    return (few @ few.T + chain + chain.T > 0).astype(np.float64)


def _jacobians(rest: RestMesh, result: _Floats) -> _Floats:
    """Return the Jacobians of the faces; those of collapsed faces map only their longest edges."""
    solid = rest.solid[:, None, None]
    completed = completed_jacobians(rest, result)
    return np.where(solid, completed, jacobians_from_verts(rest.gradient, result))


def _stretched(stretch: _Floats, share: float) -> _Floats:
    """Return (1 - t) I + t S, with a geometric continuation of what shrinks beyond the result."""
    straight = (1 - share) * np.eye(3) + share * stretch
    if share <= 1:
        return straight
    symmetric = np.abs(stretch - stretch.transpose(0, 2, 1)).max((1, 2)) < 1e-6 * np.abs(stretch).max((1, 2))
    sizes, axes = np.linalg.eigh(stretch[symmetric])
    sizes = np.where(sizes < 1, np.maximum(sizes, 0.0) ** share, 1 + share * (sizes - 1))
    straight[symmetric] = (axes * sizes[:, None, :]) @ axes.transpose(0, 2, 1)
    return straight


def _turned(vectors: _Floats, lines: _Floats) -> _Floats:
    """Return lines (B, 3) rotated about the vectors (B, 3)."""
    return np.einsum("bij,bj->bi", rotation_matrices(vectors), lines) if len(lines) else lines


def _group_means(weights: _Floats, values: _Floats, groups: NDArray[np.int64]) -> _Floats:
    """Return the weighted means (G, 3) of values (V, 3) over groups of rows."""
    total = np.bincount(groups, weights)
    sums = [np.bincount(groups, weights * column) for column in values.T]
    return np.stack(sums, 1) / total[:, None]


def polar_rotations(jacobians: _Floats) -> tuple[_Floats, _Flags]:
    """Return the rotations (F, 3, 3) of the polar decompositions, and whether each Jacobian determines its own."""
    u, size, vh = np.linalg.svd(jacobians)
    mirrored = np.linalg.det(u @ vh) < 0
    u[mirrored, :, 2] *= -1
    return u @ vh, size[:, 1] > _FLAT * np.maximum(size[:, 0], np.finfo(float).tiny)


def rotation_matrices(vectors: _Floats) -> _Floats:
    """Return the rotations (F, 3, 3) about the vectors (F, 3) by their lengths in radians."""
    return np.asarray(Rotation.from_rotvec(vectors).as_matrix())


def rotation_vectors(jacobians: _Floats, known: _Flags, pairs: sparse.csr_matrix) -> _Floats:
    """Return rotation vectors (F, 3), in radians, of which neighbours agree; their lengths may exceed pi.

    `jacobians` is (F, 3, 3) float64. `known`, (F,) bool: false where the Jacobian means nothing; such an element turns
    like a neighbour. `pairs`, sparse (F, F): nonzero for neighbours. Pairs with larger values are used only where
    smaller ones do not connect the elements.
    """
    rotations, determined = polar_rotations(jacobians)
    known = known & determined
    own = np.asarray(Rotation.from_matrix(rotations).as_rotvec())
    own[~known] = 0.0
    graph = sparse.triu(pairs, 1).tocoo()
    relative = (rotations[graph.row] * rotations[graph.col]).sum((1, 2))
    length = np.arccos(np.clip((relative - 1) / 2, -1, 1)) + _SHORTEST + _UNCERTAIN * (graph.data - 1)
    length = np.where(known[graph.row] & known[graph.col], length, _UNCERTAIN * graph.data)
    tree = minimum_spanning_tree(sparse.csr_matrix((length, (graph.row, graph.col)), shape=pairs.shape))
    angle = np.where(known, np.linalg.norm(own, axis=1), np.inf)
    order, parents = _orders(tree, angle)
    vectors = own.copy()
    _unwrap(order, parents, known, vectors)
    return vectors


def _orders(tree: sparse.csr_matrix, angle: _Floats) -> tuple[_Index, _Index]:
    """Return an order in which every element follows its parent in the forest, and the parents; -1 for roots."""
    # Each tree is rooted at its least angle.
    _, labels = sparse.csgraph.connected_components(tree, directed=False)
    by_angle = np.lexsort((angle, labels))
    _, first = np.unique(labels[by_angle], return_index=True)
    count = len(angle)
    # One more element, joined to all roots, makes the forest a tree.
    roots = by_angle[first]
    joined = sparse.coo_matrix((np.ones(len(roots)), (roots, np.full(len(roots), count))), (count + 1, count + 1))
    edges = sparse.coo_matrix(tree)
    edges.resize((count + 1, count + 1))
    order, parents = breadth_first_order((joined + edges).tocsr(), count, directed=False)
    parents = np.where(parents == count, -1, parents)[:count]
    return order[1:].astype(np.int64), parents.astype(np.int64)


@kernel
def _unwrap(order: _Index, parents: _Index, known: _Flags, vectors: _Floats) -> None:
    """Replace each vector by its equivalent nearest to the parent's."""
    for element in order:
        parent = parents[element]
        if parent < 0:
            continue
        if not known[element]:
            vectors[element] = vectors[parent]
            continue
        vector, before = vectors[element], vectors[parent]
        angle = math.sqrt((vector**2).sum())
        length = math.sqrt((before**2).sum())
        if angle < 1e-6:
            # The axis is arbitrary: turn about the parent's, by whole turns.
            turns = round(length / _FULL_TURN)
            vectors[element] = before * (turns * _FULL_TURN / length) if turns else vector
            continue
        axis = vector / angle
        turns = round(((axis * before).sum() - angle) / _FULL_TURN)
        vectors[element] = (angle + _FULL_TURN * turns) * axis


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
