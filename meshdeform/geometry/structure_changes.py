"""Measure what a person would see at once, and no judge does: lost symmetry, flatness and contacts.

The figures compare a result with its source, are shares of the diagonal of the shape in question unless said otherwise,
and are 0 for a result that is its source, or that is its source scaled, moved, or stretched along an axis.

::

    asymmetry   mean_p |R x'(p) - x'(q)|     p, q: points of the source that are mirror images; R: the reflection
    flatness    rms distance of a flat piece from its best plane, over the diagonal of the piece; the mean by area
    contacts    mean distance of points on different components that touched at rest

A source counts as symmetric if four fifths of its surface have a mirror image within `_MATCHED`; of two such
planes that match equally, the better kept one counts.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import NearestPoints

_Floats = NDArray[np.float64]
_SAMPLES = 20_000
_MATCHED = 0.006
_SYMMETRIC_SHARE = 0.8
_AS_GOOD = 0.02
"""By how much less of the surface may match at a plane that is as good as the best one."""
_FLAT_COSINE = float(np.cos(np.radians(1.0)))
_FLAT_SHARE = 0.005
"""Share of the area from which a flat piece counts."""
_FLAT_RMS = 0.002
_CONTACT = 0.01
_PARTNERS = 8
_CORNERS = 100_000
"""Vertices at which contacts are sought beside the random points; twice as many are still all taken."""


@dataclass(frozen=True)
class StructureChanges:
    """Changes of mirror symmetry, flat pieces and contacts."""

    asymmetry: float | None  # added; None if the source is not symmetric
    flatness: float | None  # lost; None if the source has no flat piece
    contacts: float | None  # growth of the mean gap; None if no components touch
    components: int

    def to_dict(self) -> dict[str, float | int | None]:
        """Return the figures by name."""
        return asdict(self)


@dataclass(frozen=True)
class _RandomPoints:
    """Random points on the source, uniform by area: their faces' corners (P, 3) and barycentric coordinates (P, 3)."""

    corners: NDArray[np.int64]
    weights: _Floats

    @classmethod
    def draw(cls, rest: RestMesh) -> _RandomPoints:
        rng = np.random.default_rng(0)
        share = np.cumsum(rest.areas)
        face = np.searchsorted(share, rng.random(_SAMPLES) * share[-1], side="right").clip(max=len(share) - 1)
        root, second = np.sqrt(rng.random(_SAMPLES)), rng.random(_SAMPLES)
        return cls(rest.faces[face], np.stack([1 - root, root * (1 - second), root * second], 1))

    def on(self, verts: _Floats) -> _Floats:
        return np.asarray((self.weights[..., None] * verts[self.corners]).sum(1))


def measure_structure(source: TriangleMesh, result: TriangleMesh) -> StructureChanges:
    """Compare a result with its source, a mesh of the same faces whose up axis is +Y."""
    rest, before, after = RestMesh.of(source), source.verts, result.verts
    drawn = _RandomPoints.draw(rest)
    components = rest.components
    return StructureChanges(
        _asymmetry(rest, drawn, after),
        _flatness(rest, after),
        _contacts(drawn, components, before, after),
        int(rest.num_components),
    )


def _diagonal(verts: _Floats) -> float:
    return float(np.linalg.norm(np.ptp(verts, axis=0)))


def _asymmetry(rest: RestMesh, drawn: _RandomPoints, after: _Floats) -> float | None:
    before = rest.verts
    points = drawn.on(before)
    asymmetry: dict[float, float] = {}
    axes = (0, 2)
    for axis, (mirrored, partners) in zip(axes, NearestPoints.of_mirrored(rest, points, axes), strict=True):
        matched = partners.distances(mirrored) < _MATCHED * _diagonal(before)
        if (share := float(matched.mean())) >= _SYMMETRIC_SHARE:
            old, new = (_mirror_error(drawn.on(v), partners.blend(v), matched, axis, v) for v in (before, after))
            asymmetry[share] = min(max(0.0, new - old), asymmetry.get(share, np.inf))
    # A cart is nearly its own mirror image from front to back: that is not the symmetry to keep.
    return min((error for share, error in asymmetry.items() if share >= max(asymmetry) - _AS_GOOD), default=None)


def _mirror_error(points: _Floats, partners: _Floats, matched: NDArray[np.bool_], axis: int, verts: _Floats) -> float:
    points, partners = points[matched].copy(), partners[matched]
    middle = np.median(points[:, axis] + partners[:, axis]) / 2
    points[:, axis] = 2 * middle - points[:, axis]
    return float(np.linalg.norm(points - partners, axis=1).mean()) / _diagonal(verts)


def _flatness(rest: RestMesh, after: _Floats) -> float | None:
    before, faces, areas = rest.verts, rest.faces, rest.areas
    pairs = sparse.coo_matrix(rest.edge_adjacency)
    normals = rest.normals
    level = (normals[pairs.row] * normals[pairs.col]).sum(1) > _FLAT_COSINE
    joined = sparse.coo_matrix((np.ones(level.sum()), (pairs.row[level], pairs.col[level])), shape=pairs.shape)
    count, piece = connected_components(joined, directed=False)
    area = np.bincount(piece, areas, count)
    lost, weights = [], []
    for number in np.flatnonzero((area >= _FLAT_SHARE * areas.sum()) & (np.bincount(piece, minlength=count) > 1)):
        corners = np.unique(faces[piece == number])
        # The faces of a finely divided sphere hardly bend from one to the next: it is not flat.
        if (old := _unevenness(before[corners])) < _FLAT_RMS:
            lost.append(max(0.0, _unevenness(after[corners]) - old))
            weights.append(area[number])
    return float(np.average(lost, weights=weights)) if lost else None


def _unevenness(points: _Floats) -> float:
    """Return the rms distance of points from their best plane, over their diagonal."""
    centred = points - points.mean(0)
    smallest = np.linalg.svd(centred, compute_uv=False)[-1] if len(points) > 3 else 0.0
    return float(smallest / np.sqrt(len(points)) / max(_diagonal(points), 1e-300))


def _contacts(drawn: _RandomPoints, components: NDArray[np.int64], before: _Floats, after: _Floats) -> float | None:
    if not components.any():
        return None
    corners = np.arange(0, len(before), max(1, len(before) // _CORNERS))
    owner = np.concatenate([components[drawn.corners[:, 0]], components[corners]])
    old, new = (np.concatenate([drawn.on(v), v[corners]]) for v in (before, after))
    near, index = cKDTree(old).query(old, k=_PARTNERS, distance_upper_bound=_CONTACT * _diagonal(before))
    first = np.repeat(np.arange(len(old)), _PARTNERS)
    second, valid = index.ravel(), np.isfinite(near.ravel())
    first, second = first[valid], second[valid]
    apart = owner[first] != owner[second]
    first, second = first[apart], second[apart]
    if not len(first):
        return None
    gaps = [np.linalg.norm(p[first] - p[second], axis=1).mean() / _diagonal(p) for p in (old, new)]
    return max(0.0, float(gaps[1] - gaps[0]))
