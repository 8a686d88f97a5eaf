"""Penalise the separation of components that are close to each other at rest.

Real assets have many components: a car's wheels, a knight's sword. The Poisson solve treats each component on its own,
so where two of them are close at rest, pairs of their vertices should keep their offset::

    E = 1 / (A P)  sum_p || (x_i - x_j) - (x_i^0 - x_j^0) ||^2        P pairs, A the area of the rest mesh

Scale-free, zero at rest, and zero for an asset of one component. Not part of the published method.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh, face_areas

__all__ = ["Attachments"]

_REACH = 0.05
"""Largest distance between neighbouring components, as a share of the bounding box diagonal."""

_PAIRS_PER_COMPONENT = 8
_MAX_QUERIES = 2_000_000


class Attachments:
    """Pairs of vertices that keep neighbouring components together.

    Parameters
    ----------
    mesh : TriangleMesh
        The rest mesh.
    components : (V,) int64
        Component of each vertex.
    """

    def __init__(self, mesh: TriangleMesh, components: Tensor) -> None:
        pairs = _neighbours(mesh.verts.numpy(), components.numpy(), np.unique(mesh.faces.numpy()))
        self._first, self._second = torch.from_numpy(pairs[:, 0]), torch.from_numpy(pairs[:, 1])
        self._offsets = mesh.verts[self._first] - mesh.verts[self._second]
        self._area = max(float(face_areas(mesh.verts, mesh.faces).sum()), 1e-300)

    def __len__(self) -> int:
        return len(self._first)

    def penalty(self, verts: Tensor) -> Tensor:
        """Return the energy of deformed positions (V, 3) float64: a differentiable float64 scalar."""
        if not len(self):
            return verts.new_zeros(())
        moved = verts.index_select(0, self._first) - verts.index_select(0, self._second) - self._offsets
        return moved.square().sum(1).mean() / self._area


def _neighbours(
    verts: NDArray[np.float64], components: NDArray[np.int64], used: NDArray[np.int64]
) -> NDArray[np.int64]:
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
    reach = _REACH * float(np.linalg.norm(points.max(0) - points.min(0)))
    found = []
    for number, group in enumerate(groups):
        others = candidates[owner != number]
        distance, nearest = cKDTree(verts[group]).query(verts[others], distance_upper_bound=reach)
        kept = np.argsort(distance, kind="stable")[:_PAIRS_PER_COMPONENT]
        kept = kept[np.isfinite(distance[kept])]
        found.append(np.stack([others[kept], group[nearest[kept]]], 1))
    return np.concatenate(found).astype(np.int64)
