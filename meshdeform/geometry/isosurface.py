"""Extract the surface where a function on a grid is zero, by marching tetrahedra.

Every cube is divided into the six tetrahedra around its diagonal, alike in all cubes. The result is a manifold whatever
the values are, closed unless the surface reaches the sides of the grid.

Source: Doi and Koide 1991, An Efficient Method of Triangulating Equi-Valued Surfaces by Using Tetrahedral Cells.

Level sets and truncated distances are a constant beyond their band. Its gradient is zero, so nothing there could be
projected to the surface: `continued` continues them.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from meshdeform.errors import AssetTooLargeError

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_MOST_CUBES = 500_000
"""About 3 GB; a ball that fills a grid of 192 passes through 170,000."""


def isosurface(values: _Floats, origin: _Floats, spacing: _Floats) -> tuple[_Floats, _Index]:
    """Return the vertices (V, 3) float64 and faces (F, 3) int64 of the zero set, facing the positive side.

    Parameters
    ----------
    values : (X, Y, Z) float64
        Negative inside.
    origin, spacing : (3,) float64
        Position of the first value, and distances between neighbours.

    Raises
    ------
    AssetTooLargeError
        The surface passes through more than half a million cubes, as that of noise does.
    """
    # A value of exactly zero would make triangles without area.
    tiny = 1e-9 * max(float(np.abs(values).max()), 1e-300)
    values = np.where(np.abs(values) < tiny, tiny, values)
    inside = values < 0
    shape = np.array(values.shape)
    cubes = np.stack(np.meshgrid(*[np.arange(n - 1) for n in shape], indexing="ij"), -1).reshape(-1, 3)
    count = sum(
        inside[i : i + n[0], j : j + n[1], k : k + n[2]].astype(np.int8)
        for i, j, k in itertools.product((0, 1), repeat=3)
        for n in [shape - 1]
    )
    cubes = cubes[((np.asarray(count) > 0) & (np.asarray(count) < 8)).ravel()]
    if len(cubes) > _MOST_CUBES:
        raise AssetTooLargeError(
            f"The surface passes through {len(cubes)} cells of the grid; the limit is {_MOST_CUBES}.",
            advice="Smooth its values, or make it coarser.",
        )
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    first = cubes @ strides
    tets = np.concatenate([np.stack([first + corner @ strides for corner in path], 1) for path in _paths()])
    low = inside.ravel()[tets]
    order = np.argsort(~low, axis=1, kind="stable")  # the corners inside come first
    tets = np.take_along_axis(tets, order, 1)
    number = low.sum(1)
    corners = [
        _pairs(tets[number == 1], [(0, 1), (0, 2), (0, 3)]),
        _pairs(tets[number == 3], [(0, 3), (1, 3), (2, 3)]),
        _pairs(tets[number == 2], [(0, 2), (0, 3), (1, 3)]),
        _pairs(tets[number == 2], [(0, 2), (1, 3), (1, 2)]),
    ]
    ends = np.concatenate(corners)  # (F, 3, 2), each from inside to outside
    keys, faces = np.unique(ends[..., 0] * values.size + ends[..., 1], return_inverse=True)
    edges = np.stack([keys // values.size, keys % values.size], 1)
    flat = values.ravel()
    share = flat[edges[:, 0]] / (flat[edges[:, 0]] - flat[edges[:, 1]])
    voxels = np.stack(np.unravel_index(edges, values.shape), -1)
    verts = origin + spacing * (voxels[:, 0] + share[:, None] * (voxels[:, 1] - voxels[:, 0]))
    triangles = faces.reshape(-1, 3).astype(np.int64)
    outward = spacing * (np.stack(np.unravel_index(ends, values.shape), -1) @ np.eye(3))
    outward = (outward[:, :, 1] - outward[:, :, 0]).sum(1)
    a, b, c = verts[triangles].transpose(1, 0, 2)
    wrong = (np.cross(b - a, c - a) * outward).sum(1) < 0
    triangles[wrong] = triangles[wrong][:, ::-1]
    return verts, triangles


def _paths() -> list[_Index]:
    """Return the corners of the six tetrahedra: the ways from one end of the diagonal to the other along the axes."""
    return [
        np.concatenate([[[0, 0, 0]], np.cumsum(np.eye(3, dtype=np.int64)[list(axes)], 0)])
        for axes in itertools.permutations(range(3))
    ]


def _pairs(tets: _Index, edges: list[tuple[int, int]]) -> _Index:
    return np.stack([tets[:, list(edge)] for edge in edges], 1)


def continued(values: _Floats, spacing: _Floats) -> _Floats:
    """Return the values (X, Y, Z) with distances beyond their band: those of its nearest voxel, and the way from there.

    Parameters
    ----------
    values : (X, Y, Z) float64
        Signed distances. If no voxel has the value of all its neighbours, they are returned as they are.
    spacing : (3,) float64
    """
    flat, crossed = np.ones(values.shape, np.bool_), np.zeros(values.shape, np.bool_)
    for axis in range(3):
        along, level, changes = (np.moveaxis(array, axis, 0) for array in (values, flat, crossed))
        same, change = along[1:] == along[:-1], (along[1:] < 0) != (along[:-1] < 0)
        for ends in (slice(1, None), slice(None, -1)):
            level[ends] &= same
            changes[ends] |= change
    beyond = np.zeros(values.shape, np.bool_)
    for side in (values, -values):
        constant = side[flat & (side > 0)]
        if len(constant):
            beyond |= side >= (1 - 1e-6) * constant.min()
    beyond &= ~crossed  # these are what the surface is made of, however thin the band
    if not beyond.any():
        return values
    way, nearest = distance_transform_edt(beyond, sampling=spacing, return_indices=True)
    return np.where(beyond, np.copysign(np.abs(values[tuple(nearest)]) + way, values), values)
