"""Make a set of nodes of a grid a topological ball, by growth from its deepest node.

The grid is divided into tetrahedra as `geometry/isosurface.py` does it, so that 14 nodes are around each. Their
triangles form a sphere, the link of the node. A node may join a ball without changing the topology of its surface if
the nodes of its link inside the ball are connected, and those outside as well: if it is *simple*. The deepest node
outside that is simple joins first; what is left of the set in the end are sheets one node thick, which cut its handles
where these are thinnest.

With a mirror, the first nodes along x lie in it; what grows is half of a ball, and joining a node stands for joining
its image as well. Around a node in the mirror the link is made of its half and of the image of that.

Source: Bertrand and Malandain 1994, A new characterization of three-dimensional simple points (simple points);
Kriegeskorte and Goebel 2001, An efficient algorithm for topologically correct segmentation of the cortical sheet in
anatomical MR volumes (growth in the order of depth).
"""

from __future__ import annotations

import heapq
import itertools

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from meshdeform.geometry.kernels import kernel
from meshdeform.nouns.labels import Flags, Floats, Index

__all__ = ["ball_within", "connected"]

_LEAST_PIECE = 12
"""Nodes of a loose piece below which it is left out."""


def _link(*, mirrored: bool) -> tuple[Index, Index]:
    """Return the offsets (14, 3) of the nodes around a node, and as bits which of them each touches, (14,)."""
    tets = set()
    for axes in itertools.permutations(range(3)):
        path = np.concatenate([[[0, 0, 0]], np.cumsum(np.eye(3, dtype=np.int64)[list(axes)], 0)])
        for own in range(4):
            around = path - path[own]
            tets.add(tuple(sorted(tuple(map(int, corner)) for corner in around if corner.any())))
    if mirrored:
        half = [tet for tet in tets if all(x >= 0 for x, _, _ in tet)]
        tets = {*half, *(tuple(sorted((-x, y, z) for x, y, z in tet)) for tet in half)}
    nodes = sorted({corner for tet in tets for corner in tet})
    touching = [0] * len(nodes)
    for tet in tets:
        for one, other in itertools.permutations([nodes.index(corner) for corner in tet], 2):
            touching[one] |= 1 << other
    return np.array(nodes), np.array(touching)


_LINK, _MIRROR_LINK = _link(mirrored=False), _link(mirrored=True)


def _neighbourhood() -> NDArray[np.bool_]:
    """Return which of the 27 nodes around a node it touches."""
    around = np.zeros((3, 3, 3), bool)
    around[1, 1, 1] = True
    around[tuple((_LINK[0] + 1).T)] = True
    return around


def connected(inside: Flags, *, mirrored: bool) -> Flags:
    """Return a set of nodes (X, Y, Z) as one piece without cavities, by bridges between its pieces.

    A set that does not reach the mirror gets a bridge to it.
    """
    around = _neighbourhood()
    outside = ndimage.label(~inside, around)[0]
    inside = outside != outside[-1, -1, -1]
    while True:
        pieces = ndimage.label(inside, around)[0]
        sizes = np.bincount(pieces.ravel())[1:]
        for small in np.flatnonzero(sizes < min(_LEAST_PIECE, sizes.max())):
            inside[pieces == small + 1] = False
        kept = np.flatnonzero(sizes >= min(_LEAST_PIECE, sizes.max())) + 1
        nodes = [np.argwhere(pieces == number) for number in kept]
        if mirrored and not inside[0].any():
            least = [rows[rows[:, 0].argmin()] for rows in nodes]
            start = min(least, key=lambda node: (int(node[0]), *map(int, node)))
            path = _path(start, start * [0, 1, 1])
        elif len(kept) > 1:
            path = _shortest(nodes)
        else:
            return np.asarray(inside)
        thick = np.zeros_like(inside)
        thick[tuple(path.T)] = True
        inside |= ndimage.binary_dilation(thick, around)


def _shortest(pieces: list[Index]) -> Index:
    """Return the nodes of the shortest way from the smallest piece to another one."""
    smallest = min(range(len(pieces)), key=lambda number: len(pieces[number]))
    rest = np.concatenate([nodes for number, nodes in enumerate(pieces) if number != smallest])
    distances, nearest = cKDTree(rest).query(pieces[smallest])
    start = int(distances.argmin())
    return _path(pieces[smallest][start], rest[nearest[start]])


def _path(start: Index, end: Index) -> Index:
    """Return the nodes of a straight way."""
    steps = 2 * max(int(np.abs(end - start).max()), 1)
    return np.unique(np.rint(start + np.linspace(0, 1, steps + 1)[:, None] * (end - start)).astype(np.int64), axis=0)


def ball_within(inside: Flags, *, mirrored: bool) -> Flags:
    """Return a ball that fills a connected set of nodes (X, Y, Z) but for cuts through its handles.

    The sides of the grid, but for the mirror, are not of the set.
    """
    depth = ndimage.distance_transform_edt(inside)
    seeds = depth[:1] if mirrored else depth
    ball = np.zeros(inside.shape, bool)
    seed = int(seeds.argmax())
    _grow(depth, ball, seed, mirrored, *_LINK, *_MIRROR_LINK)
    return ball


@kernel
def _one_piece(members: int, touching: Index) -> bool:
    """Return whether some nodes of a link, as bits, are one piece and not none."""
    if members == 0:
        return False
    reached = members & -members
    front = reached
    while front:
        after = 0
        for bit in range(14):
            if front >> bit & 1:
                after |= touching[bit]
        front = after & members & ~reached
        reached |= front
    return reached == members


@kernel
def _grow(
    depth: Floats,
    ball: Flags,
    seed: int,
    mirrored: bool,
    around: Index,
    touching: Index,
    mirror_around: Index,
    mirror_touching: Index,
) -> None:
    """Let a ball grow from a node to all nodes of positive depth that can join it."""
    _, rows, columns = ball.shape
    flat, joined = depth.ravel(), ball.ravel()
    queue, waiting = [(-flat[seed], seed)], np.zeros(len(flat), np.bool_)
    started = False
    while len(queue) > 0:
        node = heapq.heappop(queue)[1]
        waiting[node] = False
        i, j, k = node // (rows * columns), node // columns % rows, node % columns
        nodes, links = around, touching
        if mirrored and i == 0:
            nodes, links = mirror_around, mirror_touching
        members = 0
        for bit in range(14):
            if ball[abs(i + nodes[bit, 0]), j + nodes[bit, 1], k + nodes[bit, 2]]:
                members |= 1 << bit
        if started and not (_one_piece(members, links) and _one_piece(16383 & ~members, links)):
            continue
        started = True
        ball[i, j, k] = True
        for bit in range(14):
            at = (abs(i + nodes[bit, 0]) * rows + j + nodes[bit, 1]) * columns + k + nodes[bit, 2]
            if flat[at] > 0 and not waiting[at] and not joined[at]:
                waiting[at] = True
                heapq.heappush(queue, (-flat[at], at))
