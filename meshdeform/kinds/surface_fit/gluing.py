"""Glue triangles along their edges into a manifold surface, and split vertices where the surface only touches itself.

Edge k of a face runs from its corner k to its corner k + 1; a half-edge is the number 3 face + k.

Source: Gueziec et al. 2001, Cutting and Stitching: Converting Sets of Polygons to Manifold Surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class Topology:
    """Properties of a glued surface."""

    components: int
    border_edges: int  # edges with one face
    borders: int  # closed lines of them
    characteristics: tuple[int, ...]
    """Euler characteristic V - E + F of each component, ascending: 2, less 2 for each handle and 1 for each border."""

    @property
    def fewest_faces(self) -> int:
        """Number of faces below which no mesh has this topology.

        A component of characteristic X with B edges at its borders has F = 2 (V - X) - B; B is V at most, V at least 3.
        """
        return sum(max(3 - 2 * c, 1) for c in self.characteristics)

    @property
    def genus(self) -> int:
        """Number of handles of all components together."""
        return (sum(2 - c for c in self.characteristics) - self.borders) // 2


def glue(verts: _Floats, faces: _Index) -> _Index:
    """Return the half-edge (F, 3) that is glued to each half-edge; -1 at borders.

    Two faces are glued if they run along their edge in opposite directions. Where more than two meet, neighbours
    around the edge are glued so that the solid between them stays whole; what finds no partner becomes a border.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
        Each with three different corners.
    """
    start, end = faces.ravel(), np.roll(faces, -1, 1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((high, low))
    first = np.append(True, (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)) if len(order) else order
    begins = np.append(np.flatnonzero(first), len(order))
    sizes = np.diff(begins)
    twin = np.full(3 * len(faces), -1, np.int64)
    pairs = begins[:-1][sizes == 2]
    a, b = order[pairs], order[pairs + 1]
    opposite = start[a] == end[b]
    twin[a[opposite]], twin[b[opposite]] = b[opposite], a[opposite]
    for at in np.flatnonzero(sizes > 2):
        for one, other in _partners(verts, faces, order[begins[at] : begins[at + 1]], low, high):
            twin[one], twin[other] = other, one
    return twin.reshape(-1, 3)


def _partners(verts: _Floats, faces: _Index, edges: _Index, low: _Index, high: _Index) -> list[tuple[int, int]]:
    """Pair the half-edges of one edge whose faces follow each other around it with solid in between."""
    a, b = verts[low[edges[0]]], verts[high[edges[0]]]
    axis = (b - a) / max(float(np.linalg.norm(b - a)), 1e-300)
    tips = verts[faces[edges // 3, (edges % 3 + 2) % 3]] - a
    tips = tips - np.outer(tips @ axis, axis)
    x = tips[0] / max(float(np.linalg.norm(tips[0])), 1e-300)
    angles = np.arctan2(tips @ np.cross(axis, x), tips @ x)
    around = edges[np.argsort(angles, kind="stable")]
    forward = faces.ravel()[around] == low[edges[0]]
    # The normal of a face that runs forward points to greater angles, out of the solid: its partner is before it.
    partners, count = [], len(around)
    for i in np.flatnonzero(forward):
        j = (i - 1) % count
        if not forward[j]:
            partners.append((int(around[i]), int(around[j])))
    return partners


def fans(faces: _Index, twin: _Index) -> tuple[int, _Index]:
    """Return the number of fans, and the fan (F, 3) to which each corner belongs.

    A fan is a set of faces around one vertex that are glued to each other. A manifold has one around each vertex.
    """
    count = 3 * len(faces)
    here = np.flatnonzero(twin.ravel() >= 0)
    there = twin.ravel()[here]
    # The start of a half-edge is the end of its twin.
    following = there - there % 3 + (there % 3 + 1) % 3
    graph = sparse.coo_matrix((np.ones(len(here), np.int8), (here, following)), shape=(count, count))
    number, labels = csgraph.connected_components(graph, directed=False)
    return int(number), labels.reshape(-1, 3).astype(np.int64)


def glued_verts(verts: _Floats, faces: _Index, twin: _Index) -> tuple[_Floats, _Index]:
    """Return vertices and faces in which every fan has a vertex of its own."""
    count, labels = fans(faces, twin)
    owner = np.empty(count, np.int64)
    owner[labels.ravel()] = faces.ravel()
    order = np.argsort(owner, kind="stable")  # keeps the order of the vertices
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    return verts[owner[order]], rank[labels]


def topology(faces: _Index, twin: _Index) -> Topology:
    """Return what the surface is like. Vertices are counted by fans."""
    number, labels = fans(faces, twin)
    here = np.flatnonzero(twin.ravel() >= 0)
    glued = sparse.coo_matrix(
        (np.ones(len(here), np.int8), (here // 3, twin.ravel()[here] // 3)), shape=(len(faces), len(faces))
    )
    components, of_face = csgraph.connected_components(glued, directed=False)
    of_fan = np.empty(number, np.int64)
    of_fan[labels.ravel()] = np.repeat(of_face, 3)
    border, open_edges = (twin < 0).sum(1), np.flatnonzero(twin.ravel() < 0)
    # A line runs through each of its vertices once.
    line = labels.ravel()[open_edges], np.roll(labels, -1, 1).ravel()[open_edges]
    lines = sparse.coo_matrix((np.ones(len(open_edges), np.int8), line), shape=(number, number))
    borders = csgraph.connected_components(lines, directed=False)[0] - (number - len(open_edges))
    inner = np.bincount(of_face, (twin >= 0).sum(1), components) / 2
    edges = inner + np.bincount(of_face, border, components)
    chi = np.bincount(of_fan, minlength=components) - edges + np.bincount(of_face, minlength=components)
    return Topology(int(components), len(open_edges), int(borders), tuple(sorted(int(c) for c in chi)))
