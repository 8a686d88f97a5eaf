"""Make the first template of a family: points of its most typical shape, and of others what that one lacks."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from meshdeform.kinds.families.collection import Collection, far_apart

_FIRST = 0.6
"""Share of the points that come from the most typical shape."""
_NEIGHBOURS = 8
_LOOK = 4.0
"""How much features count beside positions where parts are made without labels."""


@dataclass
class Template:
    """The K points of all part templates."""

    points: Tensor  # (K, 3) float32: in the frame of the collection's mean box (`inference`)
    features: Tensor  # (K, F) float32
    labels: Tensor  # (K,) int64: the part of each point
    parts: int


def first_template(collection: Collection, boxed: Tensor, labels: Tensor, count: int, parts: int) -> Template:
    """Return K points with their parts.

    Parameters
    ----------
    boxed : (T, P, 3) float32
        The samples, scaled to the mean box.
    labels : (T, P) int64
        Parts of the samples of labelled shapes; -1 elsewhere. Where no shape has labels, parts are clusters.
    count : int
        K.
    """
    known = torch.nonzero((labels >= 0).all(1))[:, 0]
    pool = known if len(known) else torch.arange(len(boxed))
    pool = pool[:: max(1, len(pool) // 48)]
    few = boxed[pool][:, :: max(1, boxed.shape[1] // 256)]
    near = torch.stack([torch.cdist(few, each.expand_as(few)).amin(2).mean(1) for each in few])  # (from each, to t)
    typical = int((near + near.T).sum(0).argmin())
    owner = pool[typical]
    first = max(int(_FIRST * count), min(count, 8))
    chosen = far_apart(boxed[owner], min(first, boxed.shape[1]))
    points, features, marks = boxed[owner][chosen], collection.features[owner][chosen], labels[owner][chosen]
    while len(points) < count:
        # The sample of the collection that is farthest from all points of its part, and others around it.
        distance = torch.cdist(boxed[pool], points.expand(len(pool), -1, -1))
        if len(known):
            distance = distance.masked_fill(labels[pool][:, :, None] != marks, 10.0)
        gap = distance.amin(2)
        shape = int(gap.clamp_max(0.5).mean(1).argmax())
        count_wanted = min(max(count // 20, 1), count - len(points))
        lacking = gap[shape].topk(min(count_wanted * 4, gap.shape[1])).indices
        lacking = lacking[far_apart(boxed[pool[shape]][lacking], min(count_wanted, len(lacking)))]
        points = torch.cat([points, boxed[pool[shape]][lacking]])
        features = torch.cat([features, collection.features[pool[shape]][lacking]])
        marks = torch.cat([marks, labels[pool[shape]][lacking]])
    if not len(known):
        marks = _clusters(points, features, parts)
    return Template(points, features, marks, parts)


def _clusters(points: Tensor, features: Tensor, parts: int) -> Tensor:
    """Cut points into parts by their places and looks: k-means from points far apart."""
    scaled = torch.cat([points / points.std(0).mean(), features * (_LOOK / features.shape[1]) ** 0.5], 1)
    centres = scaled[far_apart(scaled, parts)]
    nearest = torch.cdist(scaled, centres).argmin(1)
    for _ in range(50):
        for part in range(parts):
            if (nearest == part).any():
                centres[part] = scaled[nearest == part].mean(0)
        moved = torch.cdist(scaled, centres).argmin(1)
        if torch.equal(moved, nearest):
            break
        nearest = moved
    return nearest


def graph(points: Tensor, labels: Tensor | None = None) -> Tensor:
    """Return the adjacency (K, K) float32 of each point's nearest neighbours, made symmetric.

    Neighbours are of the same part where `labels` are given; and each point has the nearest one of any part, so that
    parts stay together.
    """
    distance = torch.cdist(points, points)
    distance.fill_diagonal_(torch.inf)
    count = min(_NEIGHBOURS, len(points) - 1)
    edges = torch.zeros_like(distance)
    edges.scatter_(1, distance.topk(2 if count > 2 else count, largest=False).indices, 1.0)
    if labels is not None:
        distance = distance.masked_fill(labels[:, None] != labels, 1e3)
    rows = distance.topk(count, largest=False)
    edges.scatter_(1, rows.indices, (rows.values < 1e3).float().maximum(edges.gather(1, rows.indices)))
    return torch.maximum(edges, edges.T)
