"""Make areas of probabilities: screened smoothing over the surface, votes of whole segments, no islands.

Smoothed probabilities u of a part solve (M + L) u = M p, M the cells' areas and L the Laplacian of the dual graph with

    w = l^2 |edge| / |c_i - c_j| exp(-k (1 - n_i . n_j)),   k = 4 across a concave crease, 1 across a convex one,

so that borders run along creases; l = 0.025 of the diagonal is the length over which it smooths. Components that
nearly touch are neighbours a little. Of what is its own mirror image, both sides count alike.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.cells import Cells, connected

__all__ = ["settled", "smoothed"]

_LENGTH = 0.025
_CONCAVE, _CONVEX = 4.0, 1.0
_NEAR, _NEAR_WEIGHT, _MOST_FOR_NEAR = 0.006, 0.02, 30_000
_ALIKE = 0.008
_SEGMENT, _LOST = 0.8, 0.5
_ISLAND = 0.12


def smoothed(probabilities: Floats, cells: Cells) -> Floats:
    """Return probabilities (C, P) of parts, smoothed over the surface."""
    i, j = cells.links.T
    between = cells.centres[j] - cells.centres[i]
    bend = 1 - (cells.normals[i] * cells.normals[j]).sum(1)
    concave = (between * cells.normals[i]).sum(1) > 1e-5
    distance = np.maximum(np.linalg.norm(between, axis=1), 1e-4)
    weight = _LENGTH**2 * cells.lengths / distance * np.exp(-np.where(concave, _CONCAVE, _CONVEX) * bend)
    near = _near_components(cells)
    one, two = np.concatenate([i, near[:, 0]]), np.concatenate([j, near[:, 1]])
    weight = np.concatenate([weight, np.full(len(near), _NEAR_WEIGHT * _LENGTH**2)])
    count = len(cells)
    graph = sparse.csr_matrix((weight, (one, two)), shape=(count, count))
    graph = graph + graph.T
    mass = np.maximum(cells.areas, 1e-9)
    system = sparse.diags(mass + np.asarray(graph.sum(1)).ravel()) - graph
    factor = splu(system.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    soft = factor.solve(mass[:, None] * probabilities)
    apart, image = cKDTree(cells.centres).query(cells.centres * [-1, 1, 1])
    if np.average(np.minimum(apart, 0.05), weights=cells.areas) < _ALIKE:
        soft = (soft + soft[image]) / 2
    return np.asarray(soft)


def _near_components(cells: Cells) -> Index:
    """Return the pairs (N, 2) of cells of different components that nearly touch."""
    if cells.components.max() == cells.components.min() or len(cells) > _MOST_FOR_NEAR:
        return np.zeros((0, 2), np.int64)
    pairs = cKDTree(cells.centres).query_pairs(_NEAR, output_type="ndarray").astype(np.int64)
    return np.asarray(pairs[cells.components[pairs[:, 0]] != cells.components[pairs[:, 1]]], np.int64)


def settled(soft: Floats, cells: Cells, codes: Index, single: Flags) -> Index:
    """Return the part (C,), a column of `soft`, of each cell.

    A segment, a component cut where `codes` (C,) differ, takes the part of 80 % of its area as a whole, unless more
    than half of another part lies in it. Pieces under 12 % of the largest one of their part go to their neighbours;
    of `single` parts (P,), which an asset has once, all but the largest piece of a component.
    """
    best = soft.argmax(1)
    i, j = cells.links.T
    segments = connected(len(cells), cells.links[codes[i] == codes[j]])
    parts = soft.shape[1]
    total = np.bincount(best, cells.areas, parts)
    votes = np.bincount(segments * parts + best, cells.areas, (int(segments.max()) + 1) * parts).reshape(-1, parts)
    top = votes.argmax(1)
    lost = (votes > _LOST * total) & (votes > 0)
    lost[np.arange(len(top)), top] = False
    whole = (votes.max(1) >= _SEGMENT * votes.sum(1)) & ~lost.any(1)
    if len(votes) > 1:
        best = np.where(whole[segments], top[segments], best)
    for _ in range(2):
        best = _without_islands(best, cells, single)
    return np.asarray(best, np.int64)


def _without_islands(best: Index, cells: Cells, single: Flags) -> Index:
    """Give small pieces to the part that most of their neighbours have."""
    parts = len(single)
    i, j = cells.links.T
    same = best[i] == best[j]
    pieces = connected(len(cells), cells.links[same])
    size = np.bincount(pieces, cells.areas)
    part = np.zeros(len(size), np.int64)
    part[pieces] = best
    component = np.zeros(len(size), np.int64)
    component[pieces] = cells.components
    most, most_here = np.zeros(parts), np.zeros((int(component.max()) + 1, parts))
    np.maximum.at(most, part, size)
    np.maximum.at(most_here, (component, part), size)
    small = size < np.where(single[part], most_here[component, part], _ISLAND * most[part])
    one, two = np.concatenate([i[~same], j[~same]]), np.concatenate([j[~same], i[~same]])
    one, two = pieces[one], pieces[two]
    used = small[one] & ~small[two]
    neighbours = np.bincount(one[used] * parts + part[two[used]], minlength=len(size) * parts).reshape(-1, parts)
    moved = neighbours.any(1)
    part[moved] = neighbours[moved].argmax(1)
    return np.asarray(part[pieces])
