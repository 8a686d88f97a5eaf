"""Find T-junctions, vertices on an edge of a face that they are no corner of, and let them follow that edge.

A vertex v lies on the border edge from a to b, at rest at v = (1 - t) a + t b. The two sides share no vertex there, so
they come apart as soon as they are moved differently: a crack, through which one looks into the asset. With
displacements d, v follows the edge::

    d_v = (1 - t) d_a + t d_b

which keeps what an affine map of the edge's ends would do, and is exactly zero where nothing moves. The ends may
themselves lie on other edges. With the weights W of all such vertices from what they follow (rows of T), and of these
W_TT on each other, the displacements of all vertices follow from those of the free ones, F::

    d_T = (I - W_TT)^-1 W_TF d_F          d = P d

W_TT is nilpotent where no vertex follows itself, and the inverse a finite sum. Where two borders interleave on one
line, vertices follow each other; both are closed only if that line stays straight, which the inverse of these few rows
gives.

What counts as a T-junction
---------------------------
Only what a viewer would see as a crack, where two *borders* run along each other: v and the edge are on the border (an
edge of one face; copies of a face are one), and a border edge at v runs along the edge. So closed components that rest
on each other have none, nor does a corner that touches a border from the side, or a sheet that stands on a face.
Whether the two borders belong to one component does not matter. v lies within `TOLERANCE` of the diagonal from the edge
and a hundredth of its distance from the nearer end. Of several such edges, v follows the nearest,
and of those in one position, as welding sees it, the shortest.

Border edges are searched against a tree of boxes around border vertices, which are ordered along a Morton curve. An
edge visits only the boxes that it crosses, so the whole takes O(n log n) where borders are spread out.

Source: Karras 2012, Maximizing Parallelism in the Construction of BVHs, Octrees, and k-d Trees (Morton order).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.geometry.coincidence import WELD_TOLERANCE
from meshdeform.geometry.intersections import TooManyPairsError
from meshdeform.geometry.kernels import kernel

TOLERANCE = 10 * WELD_TOLERANCE
"""Distance from its edge, as a share of the diagonal, up to which a vertex lies on it. Most are within a tenth of it;
kits that were scaled or assembled from pieces round more."""

OPENED = 1e-3
"""Growth of that distance, as a share of the diagonal, from which a crack is seen: a pixel of 1,000."""

_WELDED = WELD_TOLERANCE / TOLERANCE
_SLANT = 0.01
"""Distance from the edge over that from its nearer end, up to which a vertex lies on it."""

_LEAF = 8
_MOST, _MOST_OF_EDGE = 1_000_000, 8
"""Pairs of a vertex and an edge that are listed; there are more only where very many borders lie on one line."""

_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts and masks that leave two empty bits after each of 21."""

_LONGEST = 64
"""Most vertices that follow each other in a ring; the longest that was seen in a kit has 29."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Junctions:
    """The vertices of one mesh that follow an edge."""

    count: int  # vertices of the mesh
    verts: _Index  # (J,) int64: the vertices that follow, ascending
    ends: _Index  # (J, 2) int64: a and b of the edge of each
    shares: _Floats  # (J,) float64: t

    @classmethod
    def of(cls, points: _Floats, faces: _Index) -> Self:
        """Find the T-junctions of a mesh at rest.

        `points`, (V, 3) float64: welded; `faces`, (F, 3) int64. There are none where more pairs of vertices and edges
        are near each other than can be searched.
        """
        try:
            verts, ends = border_contacts(points, faces)
        except TooManyPairsError:
            verts, ends = np.empty(0, np.int64), np.empty((0, 2), np.int64)
        shares, distances, lengths = _projected(points, verts, ends)
        apart = distances // max(WELD_TOLERANCE * _diagonal(points[np.unique(faces)]), 1e-300)
        order = np.lexsort((ends[:, 1], ends[:, 0], lengths, apart, verts))
        first = order[np.diff(verts[order], prepend=-1) != 0]
        found = cls(len(points), verts[first], ends[first], shares[first])
        return found.without(found._unsolvable())

    def __len__(self) -> int:
        return len(self.verts)

    def without(self, held: _Flags) -> Self:
        """Return those whose vertex is none of some (V,) whose positions follow from something else."""
        kept = ~held[self.verts]
        return type(self)(self.count, self.verts[kept], self.ends[kept], self.shares[kept])

    @cached_property
    def follow(self) -> sparse.csr_matrix:
        """P, (V, V): takes displacements, in which those of the vertices on edges do not matter, to those of all."""
        follow = _without_rings(self._weights(), *self._rings())
        free = np.ones(self.count)
        free[self.verts] = 0.0
        follow = (follow + sparse.diags(free)).tocsr()
        # Each product doubles the length of the chains that are followed to their end.
        while follow[:, self.verts].nnz:
            follow = (follow @ follow).tocsr()
        return follow

    def carried(self, moved: _Floats) -> _Floats:
        """Return displacements (V, 3) float64 with those of vertices on edges as their edge takes them."""
        return np.asarray(self.follow @ moved) if len(self) else moved

    def closed(self, rest: _Floats, points: _Floats) -> _Floats:
        """Return points (V, 3) float64, of the mesh at `rest`, with those on edges where their edge takes them."""
        return rest + self.carried(points - rest) if len(self) else points

    def joined(self, labels: _Index) -> _Index:
        """Return the labels (V,) of connected components, from 0, with those as one that a vertex on an edge joins."""
        count = int(labels.max(initial=-1)) + 1
        tied = np.concatenate([labels[self.verts], labels[self.verts]]), labels[self.ends].T.ravel()
        graph = sparse.coo_matrix((np.ones(2 * len(self)), tied), shape=(count, count))
        return np.asarray(csgraph.connected_components(graph, directed=False)[1][labels], np.int64)

    def completed(self, held: _Flags) -> _Flags:
        """Return held vertices (V,) with the ends of the edges on which they lie, which must not move either."""
        held = held.copy()
        while True:
            ends = self.ends[held[self.verts]]
            if held[ends].all():
                return held
            held[ends] = True

    def _weights(self) -> sparse.csr_matrix:
        """Return W, (V, V): the weights of the ends of each one's edge."""
        rows, values = np.repeat(self.verts, 2), np.stack([1 - self.shares, self.shares], 1).ravel()
        return sparse.csr_matrix((values, (rows, self.ends.ravel())), shape=(self.count, self.count))

    def _rings(self) -> tuple[_Index, _Index]:
        """Return the label (V,) of vertices that follow each other, and how many there are with each label."""
        labels = csgraph.connected_components(self._weights(), directed=True, connection="strong")[1].astype(np.int64)
        return labels, np.bincount(labels, minlength=self.count)

    def _unsolvable(self) -> _Flags:
        """Return flags (V,) of vertices in rings that follow nothing else, as around a fine disc, or are too long."""
        labels, sizes = self._rings()
        own = labels[self.verts]
        leaves = np.bincount(own, (labels[self.ends] != own[:, None]).any(1), len(sizes)) > 0
        following = np.bincount(own, minlength=len(sizes)) > 0
        return np.asarray(((following & ~leaves) | (sizes > _LONGEST))[labels])


def opened(rest: _Floats, faces: _Index, points: _Floats) -> int | None:
    """Return how many vertices that lie on an edge at rest have come off it by more than `OPENED`.

    `rest` and `points`, (V, 3) float64: before and after, each measured by its own diagonal; `faces`, (F, 3) int64.
    Returns None if there are too many pairs to search.
    """
    try:
        verts, ends = border_contacts(rest, faces)
    except TooManyPairsError:
        return None
    before, after = (_gaps(shape, verts, ends) / max(_diagonal(shape), 1e-300) for shape in (rest, points))
    return len(np.unique(verts[after - before > OPENED]))


def border_contacts(points: _Floats, faces: _Index) -> tuple[_Index, _Index]:
    """Return all pairs of a vertex (P,) and a border edge (P, 2) that it lies on, as T-junctions are defined above.

    Raises TooManyPairsError.
    """
    edges = _border(faces)
    verts, edge = _on_edges(points, edges, TOLERANCE * _diagonal(points[np.unique(edges)]))
    along = _along(verts, edge, edges)
    return verts[along], edges[edge[along]]


def _border(faces: _Index) -> _Index:
    """Return the edges (E, 2) of one face each, where faces of the same vertices are one."""
    ordered = np.sort(faces, axis=1)
    ordered = ordered[np.lexsort(ordered.T)]
    ordered = ordered[(np.diff(ordered, axis=0, prepend=-1) != 0).any(1)]
    count = int(faces.max(initial=0)) + 1
    keys = np.sort(np.concatenate([ordered[:, i] * count + ordered[:, j] for i, j in ((0, 1), (1, 2), (0, 2))]))
    apart = np.diff(keys, prepend=-1, append=-1) != 0
    edges = np.stack(np.divmod(keys[apart[:-1] & apart[1:]], count), 1)
    return np.asarray(edges[edges[:, 0] != edges[:, 1]])


def _on_edges(points: _Floats, edges: _Index, tolerance: float) -> tuple[_Index, _Index]:
    """Return the pairs of a vertex (P,) of the edges and the number of an edge (P,) in whose interior it lies."""
    verts = np.unique(edges)
    if not len(verts):
        return verts, verts
    order = verts[np.argsort(_morton_codes(points[verts]), kind="stable")]
    # Memory that nothing is written to is not taken.
    found = np.empty((_MOST_OF_EDGE * len(edges) + _MOST, 2), np.int64)
    count = _search(points, edges, order, _boxes(points[order]), tolerance, found)
    if count > len(found):
        raise TooManyPairsError
    pairs = found[:count]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return pairs[:, 0].copy(), pairs[:, 1].copy()


def _morton_codes(points: _Floats) -> NDArray[np.uint64]:
    """Return codes (N,) by which points that follow each other are near each other."""
    low, size = points.min(0), max(float(np.ptp(points, axis=0).max()), 1e-300)
    cells = np.minimum((points - low) / size * 2**21, 2**21 - 1).astype(np.uint64)
    for shift, mask in _SPREAD:
        cells = (cells | (cells << np.uint64(shift))) & np.uint64(mask)
    return np.asarray(cells[:, 0] | (cells[:, 1] << np.uint64(1)) | (cells[:, 2] << np.uint64(2)))


def _boxes(ordered: _Floats) -> _Floats:
    """Return boxes (2 L, 2, 3) around L leaves of `_LEAF` points each, and around pairs of boxes, from node 1 down."""
    leaves = 2 ** int(np.ceil(np.log2(max(len(ordered) / _LEAF, 1))))
    boxes = np.empty((2 * leaves, 2, 3))
    boxes[:] = ordered[-1]  # leaves without points lie at the last one
    starts = np.arange(0, len(ordered), _LEAF)
    boxes[leaves : leaves + len(starts), 0] = np.minimum.reduceat(ordered, starts)
    boxes[leaves : leaves + len(starts), 1] = np.maximum.reduceat(ordered, starts)
    while leaves > 1:
        below = boxes[leaves : 2 * leaves].reshape(-1, 2, 2, 3)
        boxes[leaves // 2 : leaves, 0], boxes[leaves // 2 : leaves, 1] = below[:, :, 0].min(1), below[:, :, 1].max(1)
        leaves //= 2
    return boxes


@kernel
def _search(points: _Floats, edges: _Index, order: _Index, boxes: _Floats, tolerance: float, found: _Index) -> int:
    """List the vertices on each edge, as far as there is room in `found`, and return how many there are."""
    leaves, count = len(boxes) // 2, 0
    stack = np.empty(64, np.int64)
    for e in range(len(edges)):
        first, second = edges[e, 0], edges[e, 1]
        x, y, z = points[first, 0], points[first, 1], points[first, 2]
        dx, dy, dz = points[second, 0] - x, points[second, 1] - y, points[second, 2] - z
        square = dx * dx + dy * dy + dz * dz
        if square == 0.0:
            continue
        stack[0], size = 1, 1
        while size > 0:
            size -= 1
            node = stack[size]
            enter, leave = _through(0.0, 1.0, x, dx, boxes[node, 0, 0], boxes[node, 1, 0], tolerance)
            enter, leave = _through(enter, leave, y, dy, boxes[node, 0, 1], boxes[node, 1, 1], tolerance)
            enter, leave = _through(enter, leave, z, dz, boxes[node, 0, 2], boxes[node, 1, 2], tolerance)
            if enter > leave:
                continue
            if node < leaves:
                stack[size], stack[size + 1] = 2 * node, 2 * node + 1
                size += 2
                continue
            start = (node - leaves) * _LEAF
            for k in range(start, min(start + _LEAF, len(order))):
                v = order[k]
                px, py, pz = points[v, 0] - x, points[v, 1] - y, points[v, 2] - z
                share = (px * dx + py * dy + pz * dz) / square
                inner = min(share, 1 - share) * math.sqrt(square)
                px, py, pz = px - share * dx, py - share * dy, pz - share * dz
                near = math.sqrt(px * px + py * py + pz * pz) <= min(tolerance, _SLANT * inner)
                # Nearer to an end, welding would have merged it.
                if near and inner > _WELDED * tolerance and v != first and v != second:
                    if count < len(found):
                        found[count, 0], found[count, 1] = v, e
                    count += 1
    return count


@kernel
def _through(
    enter: float, leave: float, at: float, step: float, low: float, high: float, tolerance: float
) -> tuple[float, float]:
    """Return the stretch of a segment, from 0 to 1, that is also between two planes or within the tolerance of them."""
    near, far = low - tolerance - at, high + tolerance - at
    if step == 0.0:
        return (enter, leave) if near <= 0.0 <= far else (1.0, 0.0)
    near, far = near / step, far / step
    return max(enter, min(near, far)), min(leave, max(near, far))


def _along(verts: _Index, edge: _Index, edges: _Index) -> _Flags:
    """Return which pairs (P,) have a border edge at their vertex that runs along their edge."""
    count = len(edges)
    on = verts * count + edge
    ends = np.concatenate([edges[:, 0], edges[:, 1]])
    order = np.argsort(ends, kind="stable")
    starts, stops = (np.searchsorted(ends[order], verts, side) for side in ("left", "right"))
    pair = np.repeat(np.arange(len(verts)), stops - starts)
    at = np.arange(len(pair)) - np.repeat(np.cumsum(stops - starts) - (stops - starts), stops - starts)
    border = order[starts[pair] + at] % max(count, 1)
    other = edges[border].sum(1) - verts[pair]
    a, b = edges[edge[pair]].T
    runs = (other == a) | (other == b)
    # The border ends inside of the edge, or goes on beyond one of its ends.
    runs |= np.isin(other * count + edge[pair], on) | np.isin(a * count + border, on) | np.isin(b * count + border, on)
    return np.asarray(np.bincount(pair[runs], minlength=len(verts)) > 0)


def _without_rings(weights: sparse.csr_matrix, labels: _Index, sizes: _Index) -> sparse.csr_matrix:
    """Return weights (V, V) with which no vertex follows itself: those in rings follow what the ring follows."""
    rows = np.flatnonzero(sizes[labels] > 1)
    if not len(rows):
        return weights
    entries = sparse.coo_matrix(weights)
    within = labels[entries.row] == labels[entries.col]
    outside = sparse.csr_matrix(
        (entries.data[~within], (entries.row[~within], entries.col[~within])), shape=weights.shape
    )
    order = rows[np.argsort(labels[rows], kind="stable")]
    slot = np.empty(len(labels), np.int64)
    slot[order] = np.arange(len(order)) - np.searchsorted(labels[order], labels[order])
    solved = [np.empty((0, 3))]
    # Rings of about one size are inverted at once.
    width = 2 ** np.ceil(np.log2(np.maximum(sizes, 1))).astype(np.int64)
    for wide in np.unique(width[labels[rows]]):
        own = order[width[labels[order]] == wide]
        rings, ring = np.unique(labels[own], return_inverse=True)
        systems = np.tile(np.eye(wide), (len(rings), 1, 1))
        inside = within & (width[labels[entries.row]] == wide) & (sizes[labels[entries.row]] > 1)
        row, col = entries.row[inside], entries.col[inside]
        systems[np.searchsorted(rings, labels[row]), slot[row], slot[col]] -= entries.data[inside]
        inverse = np.linalg.inv(systems)
        member = np.full((len(rings), wide), -1)
        member[ring, slot[own]] = own
        used = (member[:, :, None] >= 0) & (member[:, None, :] >= 0)
        first, second = np.broadcast_arrays(member[:, :, None], member[:, None, :])
        solved.append(np.stack([first[used], second[used], inverse[used]], 1))
    row, col, values = np.concatenate(solved).T
    mixed = sparse.csr_matrix((values, (row.astype(np.int64), col.astype(np.int64))), shape=weights.shape)
    alone = np.ones(len(labels))
    alone[rows] = 0.0
    return ((mixed + sparse.diags(alone)) @ outside).tocsr()


def _projected(points: _Floats, verts: _Index, ends: _Index) -> tuple[_Floats, _Floats, _Floats]:
    """Return t (P,) of the points of the lines nearest to vertices, their distances, and the edges' lengths."""
    begin, line = points[ends[:, 0]], points[ends[:, 1]] - points[ends[:, 0]]
    square = (line**2).sum(1)
    shares = ((points[verts] - begin) * line).sum(1) / np.maximum(square, 1e-300)
    distances = np.linalg.norm(points[verts] - begin - shares[:, None] * line, axis=1)
    return shares, distances, np.sqrt(square)


def _gaps(points: _Floats, verts: _Index, ends: _Index) -> _Floats:
    """Return the distances (P,) of vertices from edges."""
    begin, line = points[ends[:, 0]], points[ends[:, 1]] - points[ends[:, 0]]
    shares = np.clip(_projected(points, verts, ends)[0], 0, 1)
    return np.asarray(np.linalg.norm(points[verts] - begin - shares[:, None] * line, axis=1))


def _diagonal(points: _Floats) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
