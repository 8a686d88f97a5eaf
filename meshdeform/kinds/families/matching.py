"""Read results off an inference: parts of triangles, correspondences, existence, and what does not belong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.kinds.families.inference import Inference
from meshdeform.kinds.families.machine import HIGH, LOW

_MASS = 0.25
"""A point exists where at least this share of the mean number of samples corresponds to it."""
_NEAR = 0.05
"""And where the surface is nearer to it than this share of the diagonal."""
_TURNED = 0.1
"""Distance, in diagonals, that counts as much as opposite normals."""
_VOTES = 4
_APART = 6.0
_ROOM = 0.5
_ENOUGH = 5
"""So many labelled shapes tell how much members of a family differ."""
_UNLIKE = 1.6
"""Chosen on three families."""
_ALIKE = 0.2
"""Standard deviations of a feature: what differs by less is alike, however much alike the labelled shapes are."""
_QUANTILES = 100
NO_FAMILY, _COMPARED = 0.55, 100
"""Mean distance of the shapes of a collection from which on they are no family; and most shapes that are compared."""
_EXISTS = 0.8
"""Distance, in diagonals, that counts as much as a point that only one of two shapes has."""


@dataclass(frozen=True)
class Correspondences:
    """Where the template points lie on each shape."""

    samples: Tensor  # (T, K) int64: the sample nearest to each deformed point
    confidence: Tensor  # (T, K) float32: 0 to 1: how near the surface is, and how many samples correspond to the point
    exists: Tensor  # (T, K) float32: 0 or 1


def correspondences(inference: Inference) -> Correspondences:
    """Find the surface point nearest to each deformed template point, and whether the point exists on the shape."""
    deformed = inference.deformed / inference.box_scale()
    points = inference.collection.points
    matches = [torch.cdist(d, p).min(1) for d, p in zip(deformed, points, strict=True)]
    distance = torch.stack([each.values for each in matches])
    share = inference.mass / (points.shape[1] / deformed.shape[1])
    exists = ((share >= _MASS) & (distance < _NEAR)).float()
    confidence = torch.exp(-0.5 * (distance / (_NEAR / 2)).square()) * (share / (2 * _MASS)).clamp_max(1.0)
    return Correspondences(torch.stack([each.indices for each in matches]), confidence, exists)


def visible_points(inference: Inference, matches: Correspondences) -> tuple[Tensor, Tensor]:
    """Return the machine's points (T, K, 3), in [0.25, 0.75], and the scaling (4,): lowest x, y, z, and size."""
    points = inference.collection.points
    low = points.amin((0, 1))
    size = (points.amax((0, 1)) - low).max()
    chosen = points.gather(1, matches.samples[:, :, None].expand(-1, -1, 3))
    return LOW + (HIGH - LOW) * (chosen - low) / size, torch.cat([low, size[None]])


def descriptors(
    points: NDArray[np.float64],
    exists: NDArray[np.bool_],
    members: tuple[NDArray[np.float64], NDArray[np.bool_]] | None = None,
) -> NDArray[np.float32]:
    """Return descriptors (S, 4 K) of shapes: how far each point lies from its mean place, and whether it exists.

    They are compared by their L1 distance. The layers of the machine told members apart no better, and their structure
    part counted a thousand times as much as their surface part.

    Parameters
    ----------
    points, exists : (S, K, 3) float64, (S, K) bool
        In the frame.
    members : (points, exists), optional
        The family whose means are taken. Default: the shapes themselves.
    """
    known, there = members or (points, exists)
    mean = (known * there[:, :, None]).sum(0) / np.maximum(there.sum(0), 1)[:, None]
    ways = (points - mean) * exists[:, :, None]
    return np.concatenate([ways.reshape(len(points), -1), _EXISTS * exists], 1).astype(np.float32)


def triangle_parts(
    centres: NDArray[np.float64],
    normals: NDArray[np.float64],
    points: NDArray[np.float64],
    directions: NDArray[np.float64],
    parts: NDArray[np.float32],
) -> NDArray[np.uint8]:
    """Return the part of each triangle (F,): the vote of the samples near its centre, by distance and direction.

    Parameters
    ----------
    centres, normals : (F, 3) float64
        Of the triangles, in the frame of the samples.
    points, directions : (P, 3) float64
        The samples and their normals.
    parts : (P, L) float32
        Q(S) of the samples.
    """
    turned = _TURNED / 2
    tree = cKDTree(np.concatenate([points, turned * directions], 1))
    distance, near = tree.query(
        np.concatenate([centres, turned * np.nan_to_num(normals)], 1), k=min(_VOTES, len(points))
    )
    votes = parts[near] / (distance[:, :, None] + 1e-3)
    return np.asarray(votes.sum(1).argmax(1).astype(np.uint8))


def strangers(likelihood: Tensor) -> list[int]:
    """Return the shapes that seem to be of another family: a group whose likelihood is far below that of the others.

    The likelihoods (T,) are cut in two where the two groups are most compact and the lower one is at most half of them:
    most of a collection is the family, whatever its sub-classes. The lower group is another family if the gap between
    the means is larger than anything that one family shows: 6 standard deviations within the groups.
    """
    values, order = likelihood.double().sort()
    count = len(values)
    best, cut = float("inf"), 0
    for at in range(1, count // 2 + 1):
        within = float(values[:at].var(unbiased=False) * at + values[at:].var(unbiased=False) * (count - at))
        if within < best:
            best, cut = within, at
    gap = float(values[cut:].mean() - values[:cut].mean()) if cut else 0.0
    spread = (best / count) ** 0.5
    return sorted(order[:cut].tolist()) if cut and gap > max(_APART * spread, _ROOM) else []


def unlike(features: Tensor, labelled: Tensor) -> list[int] | None:
    """Return the shapes that are unlike every labelled one, which are of the family for certain.

    Two shapes differ by how far apart the distributions of their local features are: for each feature the distance of
    Wasserstein, the root of the mean of the squares over all. A shape is unlike the labelled ones if the nearest of
    them is farther than any of those is from the nearest other one, and clearly so. The likelihood does not tell: a
    template that bends to all sub-classes of a family bends to others as well.

    Parameters
    ----------
    features : (T, P, F) float32
        Of the samples of each shape, of unit variance over the collection.
    labelled : (T,) bool

    Returns
    -------
    list of int, optional
        None if fewer than five are labelled.
    """
    if int(labelled.sum()) < _ENOUGH:
        return None
    squares = _squares(features, features[labelled])
    squares[labelled.nonzero()[:, 0], torch.arange(squares.shape[1])] = torch.inf  # another one than itself
    nearest = squares.amin(1).sqrt()
    most = (_UNLIKE * nearest[labelled].max()).clamp_min(_ALIKE)
    return torch.nonzero((nearest > most) & ~labelled)[:, 0].tolist()


def unrelated(features: Tensor) -> tuple[float, list[int]]:
    """Return how far shapes are apart on average, and which ones are farthest from all others if they are no family.

    Parameters
    ----------
    features : (T, P, F) float32
        Of the samples of each shape, of unit variance over the collection.
    """
    some = torch.arange(0, len(features), max(1, len(features) // _COMPARED))
    apart = _squares(features[some], features[some]).sqrt()
    mean = apart.sum(1) / (len(some) - 1)
    spread = float(mean.mean())
    return spread, some[mean.argsort(descending=True)].tolist() if spread > NO_FAMILY else []


def _squares(features: Tensor, others: Tensor) -> Tensor:
    """Return the squares (T, S) of the distances between the distributions of the local features of shapes."""
    places = torch.linspace(0, features.shape[1] - 1, min(features.shape[1], _QUANTILES)).round().long()
    own, theirs = (each.sort(dim=1).values[:, places] for each in (features, others))
    squares = torch.zeros(len(own), len(theirs))
    for column in range(own.shape[2]):
        squares += (torch.cdist(own[:, :, column], theirs[:, :, column], p=1) / len(places)).square()
    return squares / own.shape[2]
