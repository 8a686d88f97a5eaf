"""Measure how far neighbouring components move apart.

Pairs of vertices of different components that are close to each other at rest should keep their offset. Of each
component, the closest few pairs within a twentieth of the diagonal count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.geometry.mesh import RestMesh, TriangleMesh

_REACH = 0.05
"""Largest distance between neighbouring components, as a share of the bounding box's diagonal."""
_PAIRS_PER_COMPONENT = 8
_MAX_QUERIES = 2_000_000


@dataclass(frozen=True)
class NeighbourOffsets:
    """Changes of the offsets between neighbouring components, as shares of the diagonal at rest.

    Attributes
    ----------
    mean, p95 : float
        Mean and 95th percentile over the pairs; 0 if there is none.
    pairs : int
    """

    mean: float
    p95: float
    pairs: int


def neighbour_offsets(rest: TriangleMesh, verts: Tensor) -> NeighbourOffsets:
    """Compare the offsets of neighbouring components with those at rest.

    Parameters
    ----------
    rest : TriangleMesh
    verts : (V, 3) float64
        Deformed positions in the same unit.
    """
    before, faces = rest.verts.numpy(), rest.faces.numpy()
    used = np.unique(faces)
    pairs = _pairs(before, RestMesh.of(rest).components.numpy(), used)
    if not len(pairs):
        return NeighbourOffsets(0.0, 0.0, 0)
    moved = verts.numpy() - before
    diagonal = float(np.linalg.norm(np.ptp(before[used], axis=0)))
    changes = np.linalg.norm(moved[pairs[:, 0]] - moved[pairs[:, 1]], axis=1) / diagonal
    return NeighbourOffsets(float(changes.mean()), float(np.percentile(changes, 95)), len(pairs))


def _pairs(verts: NDArray[np.float64], components: NDArray[np.int64], used: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return pairs (P, 2) of nearby vertices of different components, the closest few of each component."""
    none = np.empty((0, 2), np.int64)
    order = used[np.argsort(components[used], kind="stable")]
    groups = np.split(order, np.flatnonzero(np.diff(components[order])) + 1)
    # Every vertex is compared with every component; where that is too many queries, only a sample is compared.
    sampled = min(len(order), _MAX_QUERIES // len(groups)) // len(groups)
    if len(groups) < 2 or sampled < 1:
        return none
    if len(groups) * len(order) > _MAX_QUERIES:
        groups = [group[np.linspace(0, len(group) - 1, min(sampled, len(group))).astype(np.int64)] for group in groups]
    candidates = np.concatenate(groups)
    owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    points = verts[candidates]
    reach = _REACH * float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = []
    for number, group in enumerate(groups):
        elsewhere = candidates[owner != number]
        distance, nearest = cKDTree(verts[group]).query(verts[elsewhere], distance_upper_bound=reach)
        kept = np.argsort(distance, kind="stable")[:_PAIRS_PER_COMPONENT]
        kept = kept[np.isfinite(distance[kept])]
        pairs.append(np.stack([elsewhere[kept], group[nearest[kept]]], 1))
    return np.concatenate(pairs).astype(np.int64)
