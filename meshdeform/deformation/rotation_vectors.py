"""Find rotation vectors of Jacobians, of which neighbours agree.

The rotation R of a Jacobian J = R S (S symmetric) has many logarithms: about the axis n by theta + 2 pi k for every
integer k. Taken alone, two neighbours that are turned by slightly less and slightly more than pi would turn in opposite
directions. So each takes the logarithm nearest to that of a neighbour, from the least rotated one outwards along the
pairs that differ least (phase unwrapping along a minimum spanning tree).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial.transform import Rotation

from meshdeform.geometry.kernels import kernel

_Floats = NDArray[np.float64]
_FLAT = 1e-4
"""Second singular value, relative to the first, below which a Jacobian does not determine a rotation."""
_UNCERTAIN = 10.0
"""Length of a pair one of whose members has no rotation of its own; longer than any angle."""
_SHORTEST = 1e-3
_FULL_TURN = 2 * math.pi
_Flags = NDArray[np.bool_]
_Index = NDArray[np.int64]


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
