"""Triangle meshes: edges and their neighbourhood."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

__all__ = ["MeshEdges", "edges_of"]


@dataclass(frozen=True)
class MeshEdges:
    """Unique edges with their first two faces and those faces' opposite vertices (-1 where there is none)."""

    edges: Tensor
    faces: Tensor
    opposite: Tensor


def edges_of(faces: Tensor) -> MeshEdges:
    """Find the unique edges of (F, 3) int64 faces."""
    start, stop = faces[:, [1, 2, 0]].reshape(-1), faces[:, [2, 0, 1]].reshape(-1)
    opposite = faces.reshape(-1)
    owner = torch.arange(faces.shape[0]).repeat_interleave(3)
    low, high = torch.minimum(start, stop), torch.maximum(start, stop)
    n = int(faces.max()) + 1
    key, inverse, counts = torch.unique(low * n + high, return_inverse=True, return_counts=True)
    order = torch.argsort(inverse, stable=True)
    first = counts.cumsum(0) - counts
    second = (first + 1).clamp_max(order.numel() - 1)
    pair = torch.stack([order[first], torch.where(counts > 1, order[second], -1)], 1)
    take = pair.clamp_min(0)
    missing = pair < 0
    return MeshEdges(
        torch.stack([key // n, key % n], 1),
        torch.where(missing, -1, owner[take]),
        torch.where(missing, -1, opposite[take]),
    )
