"""Find what a part carries: what would fall off the asset without it.

The vertices of the part are taken away. Of the pieces that are left, those that stand on the ground stay; if the part
itself is on the ground, or none is, the largest one stays. All other pieces that touched the part are carried by it.
Pieces touch that share an edge, or whose surfaces are nearer than `NEAR` of the diagonal.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from meshdeform.plain.body import UP, Body, Flags, Floats, Index
from meshdeform.reading.cells import connected

__all__ = ["NEAR", "carried_by", "contacts", "on_ground", "touching"]

NEAR = 0.01
_ON_GROUND = 0.02
"""Height over the lowest point, as a share of the asset's, up to which something is on the ground."""
_SAMPLES = 6000
_CONTACT = 0.02
"""Distance from samples of a surface, as a share of the diagonal, up to which a vertex is in contact with it."""


def on_ground(body: Body, rows: Index) -> bool:
    """Return whether some vertices reach the ground."""
    return bool(len(rows)) and float(body.points[rows, UP].min()) < body.ground + _ON_GROUND * float(body.size[UP])


def carried_by(body: Body, inside: Flags) -> list[Flags]:
    """Return the pieces (V,) that a part, given by its vertices (V,), carries."""
    node = _pieces(body, inside)
    count = int(node.max()) + 1
    own = np.zeros(count, bool)
    own[node[inside]] = True
    positions, at, masses = _samples_of(body, node)
    links = _links(body, node, positions, at, count)
    outside = np.flatnonzero(~own)
    if not len(outside):
        return []
    labels = csgraph.connected_components(links[outside][:, outside], directed=False)[1]
    groups = [outside[labels == k] for k in range(labels.max() + 1)]
    held = np.asarray(links[:, np.flatnonzero(own)].sum(1)).ravel()
    stays = _staying(body, node, groups, masses, inside)
    return [np.isin(node, group) for number, group in enumerate(groups) if number not in stays and held[group].any()]


def _pieces(body: Body, inside: Flags) -> Index:
    """Return the connected piece of each vertex (V,), where no edge leads from a part to the rest."""
    edges = body.edges.tocoo()
    same = inside[edges.row] == inside[edges.col]
    return connected(len(inside), np.stack([edges.row[same], edges.col[same]], 1))


def _samples_of(body: Body, node: Index) -> tuple[Floats, Index, Floats]:
    """Return points on the surface and at vertices, the piece of each, and the mass of each piece."""
    positions, _, faces = body.sampled(_SAMPLES)
    of_face = node[body.faces[faces][:, 0]]
    masses = np.bincount(of_face, minlength=int(node.max()) + 1).astype(float)
    step = max(1, len(node) // _SAMPLES)
    return np.concatenate([positions, body.points[::step]]), np.concatenate([of_face, node[::step]]), masses


def _links(body: Body, node: Index, positions: Floats, at: Index, count: int) -> sparse.csr_matrix:
    """Return which pieces touch, (N, N)."""
    edges = body.edges.tocoo()
    across = node[edges.row] != node[edges.col]
    near = cKDTree(positions).query_pairs(NEAR * body.diagonal, output_type="ndarray")
    near = at[near]
    near = near[near[:, 0] != near[:, 1]]
    rows = np.concatenate([node[edges.row[across]], near[:, 0], near[:, 1]])
    columns = np.concatenate([node[edges.col[across]], near[:, 1], near[:, 0]])
    return sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))


def _staying(body: Body, node: Index, groups: list[Index], masses: Floats, inside: Flags) -> set[int]:
    """Return the numbers of the groups of pieces that no part carries."""
    standing = {k for k, group in enumerate(groups) if on_ground(body, np.flatnonzero(np.isin(node, group)))}
    if standing or on_ground(body, np.flatnonzero(inside)):
        return standing
    sizes = [float(masses[group].sum()) for group in groups]
    largest = int(np.argmax(sizes))
    return {largest} if sizes[largest] > masses[np.unique(node[inside])].sum() else set()


def contacts(body: Body, rows: Index, other: Flags) -> Floats:
    """Return the vertices (N, 3) of a piece that are near the surface of other vertices (V,); else as `touching`."""
    positions, _, faces = body.sampled(_SAMPLES)
    surface = positions[other[body.faces[faces]].all(1)]
    if len(surface):
        own = body.points[rows]
        near = np.asarray(own[cKDTree(surface).query(own)[0] <= _CONTACT * body.diagonal])
        if len(near):
            return near
    inside = np.zeros(len(other), bool)
    inside[rows] = True
    return touching(body, inside, other)


def touching(body: Body, one: Flags, other: Flags) -> Floats:
    """Return points (N, 3) where two sets of vertices (V,) meet: on edges between them, else where they are nearest."""
    edges = body.edges.tocoo()
    across = one[edges.row] & other[edges.col]
    if across.any():
        return np.asarray((body.points[edges.row[across]] + body.points[edges.col[across]]) / 2)
    if not one.any() or not other.any():
        return np.zeros((0, 3))
    own = body.points[one]
    distance = cKDTree(body.points[other]).query(own)[0]
    return np.asarray(own[distance <= distance.min() + NEAR * body.diagonal])
