"""Clean the boundaries of the parts of a segmented surface: no stray patches, pieces of one part, short boundaries."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.geometry.coincidence import WELD_TOLERANCE, coincident
from meshdeform.kinds.families.cut import shortened

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_STRAY = 0.25
"""A patch of a part is stray if it has less than this share of the area of the part's largest one."""
_ROUNDS = 4
_MAJORITY, _OF_LARGE, _LARGE, _WHOLE = 0.6, 0.85, 0.25, 0.9
"""A part with more than the first share of a connected piece has all of it; with more than the second, where the piece
is more than the third share of the surface, as a car's body with its cabin is; none has it where it is more than the
last: a model that is welded to one piece says nothing by its pieces."""
_LIMB = 1.5
"""A patch of another part is no mistake within a piece if its boundary is shorter than this many roots of its area, as
around the trunk of a tree: mistakes have 2.1 and more on vehicles and trees, and limbs 0.9 and less."""
_SPINDLE, _LEAST_LIMB = 1.0, 0.02
"""And with less than so many roots it is stray only below the second share of the largest patch of its part."""

_BOUNDARY = 0.03
"""A boundary of the length of the diagonal is worth as much as this share of the square of the diagonal."""


def welded(positions: _Floats, triangles: _Index) -> _Index:
    """Return the triangles (F, 3) with the same number for corners at the same place."""
    used = np.unique(triangles)
    points = positions[used]
    number = np.full(len(positions), -1, np.int64)
    number[used] = used[coincident(points, WELD_TOLERANCE * float(np.linalg.norm(np.ptp(points, axis=0))))]
    return number[triangles]


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
        stray = _stray(smoothed, patches, areas, faces[cut], lengths[cut])
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
    majority = np.where(size > _LARGE * size.sum(), _OF_LARGE, _MAJORITY)
    clear = (share.max(1) > majority * size) & (size <= _WHOLE * size.sum())
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


def _stray(parts: NDArray[Any], patches: _Index, areas: _Floats, cut: _Index, lengths: _Floats) -> NDArray[np.bool_]:
    """Return which patches are stray: small, with a boundary, and no limbs, as the spindles of a back are.

    `cut` (C, 2) are the pairs of triangles across boundaries, `lengths` (C,) those of the edges there.
    """
    size = np.bincount(patches, areas)
    owner = np.zeros(len(size), np.int64)
    owner[patches] = parts
    largest = np.zeros(int(owner.max()) + 1)
    np.maximum.at(largest, owner, size)
    around = np.bincount(patches[cut].reshape(-1), np.repeat(lengths, 2), len(size))
    small = size < np.where(around < _SPINDLE * np.sqrt(size), _LEAST_LIMB, _STRAY) * largest[owner]
    return np.asarray((around > 0) & small)
