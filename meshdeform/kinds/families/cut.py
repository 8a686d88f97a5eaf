"""Shorten the boundaries between parts of a surface by minimum cuts, at the least area that changes its part.

Source: Boykov, Veksler and Zabih 2001 (expansion moves), with the graph of Kolmogorov and Zabih 2004.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_ROUNDS = 2
_UNITS = 5e7
"""The whole area in capacities, which are 32-bit integers."""


def shortened(parts: _Index, areas: _Floats, faces: _Index, lengths: _Floats) -> _Index:
    """Return parts (F,) with the least sum of the area that changes its part and of the boundaries' `lengths`.

    Parameters
    ----------
    parts : (F,) int64
    areas : (F,) float64
    faces, lengths : (E, 2) int64, (E,) float64
        Triangles that share an edge, and what a boundary there costs, in units of `areas`.
    """
    labels, scale = parts, _UNITS / max(float(areas.sum()), 1e-300)
    for _ in range(_ROUNDS):
        before = labels
        for part in np.unique(parts):
            labels = _expanded(labels, int(part), parts, scale * areas, faces, scale * lengths)
        if (labels == before).all():
            break
    return labels


def _expanded(labels: _Index, part: int, fixed: _Index, areas: _Floats, faces: _Index, lengths: _Floats) -> _Index:
    """Return the best parts (F,) where each triangle keeps its own or takes one part."""
    i, j = faces.T
    neither = lengths * (labels[i] != labels[j])
    second, first = lengths * (labels[i] != part), lengths * (labels[j] != part)  # which one takes the part
    cost = areas * (part != fixed) - areas * (labels != fixed)
    np.add.at(cost, i, first - neither)
    np.add.at(cost, j, -first)
    between, cost = np.rint(second + first - neither).astype(np.int32), np.rint(cost).astype(np.int32)
    count, every = len(labels), np.arange(len(labels))
    takes, keeps, cut = cost > 0, cost < 0, between > 0
    rows = np.concatenate([np.full(takes.sum(), count), every[keeps], i[cut]])
    columns = np.concatenate([every[takes], np.full(keeps.sum(), count + 1), j[cut]])
    capacity = np.concatenate([cost[takes], -cost[keeps], between[cut]])
    graph = sparse.csr_matrix((capacity, (rows, columns)), shape=(count + 2, count + 2))
    rest = graph - csgraph.maximum_flow(graph, count, count + 1).flow
    rest.data[rest.data < 0] = 0
    rest.eliminate_zeros()
    kept = np.zeros(count + 2, bool)
    kept[csgraph.breadth_first_order(rest, count, return_predecessors=False)] = True
    return np.where(kept[:count], labels, part)
