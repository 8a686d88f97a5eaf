"""Sample the surfaces of a collection, with the local features of each sample, and turn them to face one way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.errors import AssetEmptyError
from meshdeform.geometry.surface_samples import even_samples

FEATURES = 13
"""Number of local features of a sample."""

_RADII = (0.06, 0.12, 0.24)
"""Radii of the neighbourhoods that features look at, in diagonals."""
_DENSE = 8
"""Candidates for each sample that is kept; the kept ones are far from each other."""
_TURNS = 24
_KEEP, _MOST, _SURE = 0.93, 0.5, 0.8
"""A turn must lower the distance to the other shapes below the first share of what it is without one; where the second
share of the shapes faces one way, below the third."""
_COMPARED, _PROBES = 192, 16


@dataclass(frozen=True)
class SampledShape:
    """The samples of one surface."""

    points: NDArray[np.float64]
    """(P, 3) float64: with the middle of the bounding box at 0 and its diagonal as unit, +Y up."""
    normals: NDArray[np.float64]  # (P, 3) float64
    triangles: NDArray[np.int64]  # (P,) int64: the triangle of each sample
    weights: NDArray[np.float64]  # (P, 3) float64: its barycentric coordinates
    centre: NDArray[np.float64]  # (3,) float64
    diagonal: float  # of the bounding box in the file's units
    features: Tensor
    """(P, FEATURES) float32: what the surface is like around each sample, whichever way the shape faces."""
    neighbours: Tensor  # (P, 8) int64: the nearest samples


@dataclass(frozen=True)
class Collection:
    """The samples of T shapes, each with P samples."""

    # (T, P, 3) float32: in the frame of `SampledShape`, after the turn
    points: Tensor
    normals: Tensor
    features: Tensor  # (T, P, FEATURES) float32: of zero mean and unit variance over the collection
    neighbours: Tensor  # (T, P, 8) int64: the nearest samples of the same shape
    turns: Tensor  # (T,) float32: the turn of each shape around +Y in radians
    boxes: Tensor  # (T, 3) float32: size of each shape's bounding box

    @classmethod
    def of(
        cls, points: Tensor, normals: Tensor, features: Tensor, neighbours: Tensor, *, turn: bool = True
    ) -> Collection:
        """Turn the shapes alike and bring the features of their samples to one scale.

        Parameters
        ----------
        points, normals : (T, P, 3) float32
        features : (T, P, FEATURES) float32
        neighbours : (T, P, 8) int64
            As in `SampledShape`.
        turn : bool
            Whether shapes may be turned around the vertical axis.
        """
        turns = turned_alike(points) if turn else torch.zeros(len(points))
        points = rotated(points, turns)
        low, high = points.amin(1, keepdim=True), points.amax(1, keepdim=True)
        flat = features.reshape(-1, FEATURES)
        scaled = (features - flat.mean(0)) / flat.std(0).clamp_min(1e-6)
        boxes = (high - low)[:, 0].clamp_min(1e-3)
        return cls(points, rotated(normals, turns), scaled, neighbours, turns, boxes)


def sample_shape(positions: NDArray[np.float64], triangles: NDArray[np.int64], count: int, seed: int) -> SampledShape:
    """Spread samples over a surface: many by area, of which those are kept that are far from each other.

    Parameters
    ----------
    positions : (N, 3) float64
    triangles : (F, 3) int64
    count : int
        Number of samples P.

    Raises
    ------
    AssetEmptyError
        The surface has no area.
    """
    corners = positions[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(cross, axis=1) / 2
    if not areas.sum() > 0:
        raise AssetEmptyError("Every triangle of the asset has zero area.", advice="Send a mesh with a surface.")
    used = positions[np.unique(triangles)]
    low, high = used.min(0), used.max(0)
    centre, diagonal = (low + high) / 2, float(np.linalg.norm(high - low))
    face, weights = even_samples(areas, _DENSE * count, seed)
    points = (np.einsum("pc,pcd->pd", weights, corners[face]) - centre) / diagonal
    kept = far_apart(torch.from_numpy(points).float(), count).numpy()
    normals = cross[face[kept]] / (2 * areas[face[kept], None])
    looks = _describe(torch.from_numpy(points[kept]).float(), torch.from_numpy(normals).float())
    return SampledShape(points[kept], normals, face[kept], weights[kept], centre, diagonal, *looks)


def far_apart(points: Tensor, count: int) -> Tensor:
    """Return the indices of `count` points, each the farthest from those before it."""
    chosen = torch.zeros(count, dtype=torch.long)
    distance = (points - points[0]).square().sum(1)
    for i in range(1, count):
        chosen[i] = distance.argmax()
        distance = torch.minimum(distance, (points - points[chosen[i]]).square().sum(1))
    return chosen


def rotated(vectors: Tensor, turns: Tensor) -> Tensor:
    """Turn the vectors (T, P, 3) of each shape around +Y by its angle (T,)."""
    cos, sin = turns.cos()[:, None], turns.sin()[:, None]
    x, y, z = vectors.unbind(-1)
    return torch.stack([cos * x + sin * z, y, cos * z - sin * x], -1)


def turned_alike(points: Tensor) -> Tensor:
    """Return the turn around +Y (T,) that places each shape best on the others.

    The reference are the shapes nearest to all others as they are. A collection most of which faces one way already
    keeps its directions, but for quarter turns that place a shape far better: what is merely a little nearer does not
    tell the front of a vehicle from its back.
    """
    few = points[:, :: max(1, points.shape[1] // _COMPARED)]
    cost = _turned_costs(few, per_axis=True)
    keep = _KEEP
    if float((cost.amin(1) >= _KEEP * cost[:, 0]).float().mean()) >= _MOST:
        cost, keep = (cost * _turned_costs(few, per_axis=False)).sqrt(), _SURE
        cost[:, torch.arange(_TURNS) % (_TURNS // 4) != 0] = torch.inf
    return torch.where(cost.amin(1) < keep * cost[:, 0], cost.argmin(1) * (2 * math.pi / _TURNS), 0.0)


def _turned_costs(few: Tensor, *, per_axis: bool) -> Tensor:
    """Return how far each shape (T, P, 3), turned by each angle (T, _TURNS), is from the typical ones."""
    # `per_axis`: scaled along x, y and z to bounding boxes of size 1, so that only what is where counts.

    def boxed(sets: Tensor) -> Tensor:
        low, high = sets.amin(1, keepdim=True), sets.amax(1, keepdim=True)
        return (sets - (low + high) / 2) / ((high - low).clamp_min(1e-3) if per_axis else 1.0)

    probe = boxed(few[:: max(1, len(few) // _PROBES)])
    between = torch.stack([_mean_distance(each.expand_as(probe), probe) for each in probe])
    # The middle half: what all others are compared with.
    typical = probe[between.sum(1).argsort()[: max(1, len(probe) // 2)]]
    angles = torch.arange(_TURNS) * (2 * math.pi / _TURNS)
    turned = [boxed(rotated(each.expand(_TURNS, -1, -1), angles)) for each in few]
    return torch.stack(
        [torch.stack([_mean_distance(t, e.expand_as(t)) for e in typical]).median(0).values for t in turned]
    )


def _mean_distance(a: Tensor, b: Tensor) -> Tensor:
    """Return the mean distance (B,) between point sets (B, P, 3) and their nearest points in both directions."""
    distances = torch.cdist(a, b)
    return distances.amin(2).mean(1) + distances.amin(1).mean(1)


def _describe(points: Tensor, normals: Tensor) -> tuple[Tensor, Tensor]:
    """Return features (P, FEATURES) of the samples of one shape and their 8 nearest neighbours (P, 8)."""
    distance = torch.cdist(points, points)
    features = []
    products = (points[:, :, None] * points[:, None]).reshape(-1, 9)
    for radius in _RADII:
        near = (distance < radius).float()
        share = near / near.sum(1, keepdim=True)
        mean = share @ points
        covariance = (share @ products).reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None]
        values = torch.linalg.eigvalsh(covariance.double()).float().clamp_min(0).sqrt()
        total = values.sum(1).clamp_min(1e-9)
        # How much like a line, and like a body rather than a sheet, the neighbourhood is; and how heavy it is above.
        features += [(values[:, 2] - values[:, 1]) / total, values[:, 0] / total, (mean - points)[:, 1] / radius]
    aside = points[:, [0, 2]].norm(dim=1)
    features += [
        normals[:, 1].abs(),
        points[:, 1] / (points[:, 1].amax() - points[:, 1].amin()).clamp_min(1e-3),
        aside / aside.amax().clamp_min(1e-3),
        distance.mean(1),
    ]
    return torch.stack(features, 1), distance.topk(9, largest=False).indices[:, 1:]
