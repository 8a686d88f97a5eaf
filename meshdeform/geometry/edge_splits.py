"""Split edges of triangles at new vertices, so that neighbours that share an edge keep sharing it. Without torch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

_Index = NDArray[np.int64]


def unique_edges(triangles: _Index) -> tuple[_Index, _Index]:
    """Return the edges (E, 2) of triangles (T, 3), smaller vertex first, and the edge of each side (T, 3).

    The sides of a triangle join its corners 0 and 1, 1 and 2, 2 and 0.
    """
    if not len(triangles):
        return np.empty((0, 2), np.int64), np.empty((0, 3), np.int64)
    pairs = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    base = int(triangles.max()) + 1
    keys, sides = np.unique(pairs[:, 0] * base + pairs[:, 1], return_inverse=True)
    return np.stack([keys // base, keys % base], axis=1), sides.reshape(-1, 3)


def split_triangles(triangles: _Index, middles: _Index, positions: NDArray[np.float64]) -> tuple[_Index, _Index]:
    """Replace each triangle by one more triangle than it has split sides, with the same winding.

    `triangles` is (T, 3) int64; `middles`, (T, 3) int64: the new vertex on each side (see `unique_edges`), or -1.
    `positions`, (V, 3) float64: positions of all vertices. Where two sides are split, the shorter diagonal of the rest
    is taken. Returns the triangles (M, 3), those of one source triangle together and where it was, and the source
    triangle (M,) of each.
    """
    split = middles >= 0
    count = split.sum(axis=1)
    # Turn each triangle so that one split side, or the side that is not split of three, comes first.
    first = np.where(count == 1, split.argmax(axis=1), np.where(count == 2, (~split).argmax(axis=1) + 1, 0)) % 3
    turn = (first[:, None] + np.arange(3)) % 3
    corners, new = np.take_along_axis(triangles, turn, 1), np.take_along_axis(middles, turn, 1)
    (a, b, c), (ab, bc, ca) = corners.T, new.T
    diagonals = [np.linalg.norm(positions[p] - positions[np.maximum(q, 0)], axis=1) for p, q in ((a, bc), (c, ab))]
    by_first = diagonals[0] <= diagonals[1]
    cases = (
        (count == 0, [(a, b, c)]),
        (count == 1, [(a, ab, c), (ab, b, c)]),
        ((count == 2) & by_first, [(ab, b, bc), (a, ab, bc), (a, bc, c)]),
        ((count == 2) & ~by_first, [(ab, b, bc), (a, ab, c), (ab, bc, c)]),
        (count == 3, [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]),
    )
    pieces = [(np.flatnonzero(where), np.stack(piece, 1)[where]) for where, made in cases for piece in made]
    parents = np.concatenate([parent for parent, _ in pieces])
    order = np.argsort(parents, kind="stable")
    return np.concatenate([piece for _, piece in pieces])[order], parents[order]


def longest_together(edges: _Index, locations: _Index, lengths: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return, for each of `count` edges, the length of the longest that must be split with it; 0 if it has no copy.

    `edges` and `locations`, (C,) int64: the edge that each copy is of (a mesh may be shown several times), and the
    number of its location. Copies of one edge are split together, and so are copies at one location. `lengths`, (C,)
    float64: length of each copy.
    """
    nodes = count + int(locations.max(initial=-1)) + 1
    graph = sparse.coo_matrix((np.ones(len(edges), np.int8), (edges, count + locations)), shape=(nodes, nodes))
    _, together = csgraph.connected_components(graph, directed=False)
    longest = np.zeros(nodes)
    np.maximum.at(longest, together[edges], lengths)
    return np.asarray(longest[together[:count]])
