"""Measure how clean the boundary of each part of a segmented surface is.

Parts of a collection become parts of new shapes, where a ragged boundary shows. The authors left shapes with bad
boundaries out by hand (25 % of the airplanes, 40 % of the chairs); here a measure does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import ConvexHull, QhullError

from meshdeform.geometry.coincidence import WELD_TOLERANCE, coincident
from meshdeform.kinds.families.cut import shortened

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_STRAY = 0.25
"""A patch of a part is stray if it has less than this share of the area of the part's largest one."""
_ROUNDS = 4
_MAJORITY, _WHOLE = 0.6, 0.9
"""A part with more than the first share of a connected piece has all of it, where the piece is at most the second share
of the surface: a model that is welded to one piece says nothing by its pieces."""
_LIMB = 1.5
"""A patch of another part is no mistake within a piece if its boundary is shorter than this many roots of its area, as
around the trunk of a tree: mistakes have 2.1 and more on vehicles and trees, and limbs 0.9 and less."""

_BOUNDARY = 0.03
"""A boundary of the length of the diagonal is worth as much as this share of the square of the diagonal."""


def welded(positions: _Floats, triangles: _Index) -> _Index:
    """Return the triangles (F, 3) with the same number for corners at the same place."""
    used = np.unique(triangles)
    points = positions[used]
    number = np.full(len(positions), -1, np.int64)
    number[used] = used[coincident(points, WELD_TOLERANCE * float(np.linalg.norm(np.ptp(points, axis=0))))]
    return number[triangles]


def boundary_defects(positions: _Floats, triangles: _Index, parts: NDArray[np.uint8], count: int) -> _Floats:
    """Return how unclean the boundary of each part is (L,): 0 for none or a clean one; infinite for a missing part.

    It is the sum of two shares: the area of the part in stray patches (`without_strays`); and how much longer the
    boundary's loops are than the convex hulls of their projections to their planes of best fit. A cut around a limb is
    as long as its hull, a ragged one is longer.
    Where parts are separate pieces of the mesh, there is no boundary.

    Parameters
    ----------
    positions : (N, 3) float64
    triangles : (F, 3) int64
    parts : (F,) uint8
    """
    areas = _areas(positions, triangles)
    faces, ends = _neighbours(welded(positions, triangles))
    cut = parts[faces[:, 0]] != parts[faces[:, 1]]
    patches = components(len(triangles), faces[~cut])
    stray = _stray(parts, patches, areas, faces[cut])[patches]
    defects = np.full(count, np.inf)
    for part in np.unique(parts):
        chosen = parts == part
        across = cut & chosen[faces].any(1)
        share = float(areas[chosen & stray].sum() / max(areas[chosen].sum(), 1e-300))
        defects[part] = share + _raggedness(positions, ends[across]) if across.any() else 0.0
    return defects


def without_strays(positions: _Floats, triangles: _Index, parts: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the parts (F,) with stray patches given to the part around them with which they share most boundary.

    First, a connected piece of the surface that is mostly of one part becomes that part, unless it is nearly the whole
    surface or has a limb of another part. Then a patch is stray if it is less than a quarter as large as the largest
    patch of its part, and is not by itself a connected piece. Last, boundaries are made shorter (`shortened`).
    """
    areas, corners = _areas(positions, triangles), welded(positions, triangles)
    faces, ends = _neighbours(corners)
    lengths = np.linalg.norm(positions[ends[:, 0]] - positions[ends[:, 1]], axis=1)
    labels = parts.astype(np.int64)
    voted = _voted(corners, labels, _smoothed(labels, areas, faces, lengths), areas, faces, lengths)
    price = _BOUNDARY * float(np.linalg.norm(np.ptp(positions[np.unique(triangles)], axis=0)))
    return shortened(_smoothed(voted, areas, faces, lengths), areas, faces, price * lengths).astype(np.uint8)


def _smoothed(parts: _Index, areas: _Floats, faces: _Index, lengths: _Floats) -> _Index:
    """Return the parts (F,) with stray patches given away; `faces` (E, 2) share edges of `lengths` (E,)."""
    smoothed = parts
    for _ in range(_ROUNDS):
        cut = smoothed[faces[:, 0]] != smoothed[faces[:, 1]]
        patches = components(len(parts), faces[~cut])
        stray = _stray(smoothed, patches, areas, faces[cut])
        if not stray.any():
            break
        shared = np.zeros((len(stray), int(smoothed.max()) + 1))
        for one, other in ((0, 1), (1, 0)):
            # Two strays beside each other would only change places.
            firm = cut & ~stray[patches[faces[:, other]]]
            np.add.at(shared, (patches[faces[firm, one]], smoothed[faces[firm, other]]), lengths[firm])
        moved = stray & (shared.sum(1) > 0)
        smoothed = np.where(moved[patches], shared.argmax(1)[patches], smoothed)
    return smoothed


def _voted(corners: _Index, parts: _Index, smooth: _Index, areas: _Floats, faces: _Index, lengths: _Floats) -> _Index:
    """Return the parts (F,) with each connected piece given to the part that has most of its area, if that is clear."""
    # It is not where the smoothed parts have a limb: a patch with a short boundary.
    piece = components(int(corners.max()) + 1, np.concatenate([corners[:, :2], corners[:, 1:]]))[corners[:, 0]]
    share = np.zeros((int(piece.max()) + 1, int(parts.max()) + 1))
    np.add.at(share, (piece, parts), areas)
    size, most = share.sum(1), share.argmax(1)
    cut = smooth[faces[:, 0]] != smooth[faces[:, 1]]
    patches = components(len(parts), faces[~cut])
    around = np.bincount(patches[faces[cut]].reshape(-1), np.repeat(lengths[cut], 2), len(parts))[patches]
    limb = (around < _LIMB * np.sqrt(np.bincount(patches, areas)[patches])) & (smooth != most[piece])
    clear = (share.max(1) > _MAJORITY * size) & (size <= _WHOLE * size.sum())
    clear[piece[limb]] = False
    return np.where(clear[piece], most[piece], parts)


def _areas(positions: _Floats, triangles: _Index) -> _Floats:
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def _neighbours(corners: _Index) -> tuple[_Index, _Index]:
    """Return the pairs of triangles (E, 2) that share an edge, and the ends (E, 2) of the edge."""
    edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(corners)), 3)
    order = np.lexsort(edges.T)
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(1) & (edges[1:, 0] != edges[1:, 1])
    return np.stack([owner[:-1][same], owner[1:][same]], 1), edges[1:][same]


def components(count: int, pairs: _Index) -> _Index:
    """Return the connected component of each of `count` things, of which pairs (E, 2) are connected."""
    graph = sparse.csr_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], np.int64)


def _stray(parts: NDArray[Any], patches: _Index, areas: _Floats, cut: _Index) -> NDArray[np.bool_]:
    """Return which patches are stray; `cut` (C, 2) are the pairs of triangles across boundaries."""
    size = np.bincount(patches, areas)
    owner = np.zeros(len(size), np.int64)
    owner[patches] = parts
    largest = np.zeros(int(owner.max()) + 1)
    np.maximum.at(largest, owner, size)
    bounded = np.zeros(len(size), bool)
    bounded[patches[cut].reshape(-1)] = True
    return np.asarray(bounded & (size < _STRAY * largest[owner]))


def _raggedness(positions: _Floats, edges: _Index) -> float:
    """Return how much longer the loops of boundary edges (E, 2) are than their hulls, as a share."""
    rows, local = np.unique(edges, return_inverse=True)
    local = local.reshape(-1, 2)
    loop = components(len(rows), local)[local[:, 0]]
    lengths = np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)
    longer = 0.0
    for each in np.unique(loop):
        length = float(lengths[loop == each].sum())
        longer += max(length - _hull(positions[np.unique(edges[loop == each])]), 0.0)
    return longer / max(float(lengths.sum()), 1e-300)


def _hull(points: _Floats) -> float:
    """Return the perimeter of the convex hull of points (P, 3) in their plane of best fit."""
    centred = points - points.mean(0)
    flat = centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    try:
        return float(ConvexHull(flat).area)  # the perimeter, in the plane
    except (QhullError, ValueError):
        return 2.0 * float(np.linalg.norm(np.ptp(flat, axis=0)))
