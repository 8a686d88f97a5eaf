"""Find the closed surface of an oriented point cloud on a grid.

The function phi whose gradient is nearest to the smoothed field of normals solves a Poisson equation, here by FFT;
the surface is where it is zero. The cells are as large as the points are far from each other. The mean value of phi
over the points is taken away, then, four times, what is left of it around each: so the tips of thin parts stay.

Source: Kazhdan 2005, Reconstruction of Solid Models from Oriented Point Sets; Kazhdan and Hoppe 2013, Screened Poisson
Surface Reconstruction (values at the points).
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

_Floats = NDArray[np.float64]
_MARGIN, _WIDE = 0.08, 2.0
"""Of the grid: a share of the size, or distances of points if these are greater."""
_NEIGHBOURS = 8
_SMOOTH, _SCREEN = 0.7, 1.0
"""Standard deviations in cells, or in distances of points if these are greater: of normals, and of what is taken."""
_FEWEST, _MOST = 32, 192
"""Cells along the longest side, as large as the fourth neighbour of a point is far."""
_ROUNDS, _LITTLE = 4, 0.02


def poisson_grid(points: _Floats, normals: _Floats) -> tuple[_Floats, _Floats, float]:
    """Return phi (X, Y, Z), negative inside; the place (3,) of its first value; and the distance of neighbours.

    Parameters
    ----------
    points, normals : (P, 3) float64
        Unit normals, to the outside.
    """
    low, high = points.min(0), points.max(0)
    size = float((high - low).max())
    near, _ = cKDTree(points).query(points, k=min(_NEIGHBOURS, len(points)))
    apart = float(np.median(near[:, 4]))
    margin = max(_MARGIN * size, _WIDE * apart)
    spacing = size + 2 * margin
    spacing /= min(max(spacing / apart, _FEWEST), _MOST)
    wide = max(apart / spacing, 1.0)
    shape = np.ceil((high - low + 2 * margin) / spacing).astype(int) + 1
    origin = (low + high) / 2 - spacing * (shape - 1) / 2
    # Each point stands for the area around it, so that denser parts do not count more.
    areas, places = near[:, -1] ** 2, (points - origin) / spacing
    field = _splat(places, normals * areas[:, None], shape)
    waves = [2 * np.pi * np.fft.fftfreq(n) for n in shape[:2]] + [2 * np.pi * np.fft.rfftfreq(shape[2])]
    k = np.stack(np.meshgrid(*waves, indexing="ij"))
    squared = (k**2).sum(0)
    squared[0, 0, 0] = 1.0
    blur = np.exp(-0.5 * (_SMOOTH * wide) ** 2 * squared)
    divergence = sum(1j * k[axis] * np.fft.rfftn(field[..., axis]) for axis in range(3))
    phi = np.fft.irfftn(-divergence * blur / squared, s=tuple(shape), axes=(0, 1, 2))
    phi -= np.average(map_coordinates(phi, places.T, order=1), weights=areas)
    counts = gaussian_filter(_splat(places, np.ones((len(points), 1)), shape)[..., 0], _SCREEN * wide)
    counts += _LITTLE * np.median(map_coordinates(counts, places.T, order=1))
    for _ in range(_ROUNDS):
        there = map_coordinates(phi, places.T, order=1)
        phi -= gaussian_filter(_splat(places, there[:, None], shape)[..., 0], _SCREEN * wide) / counts
    return phi, origin, spacing


def _splat(places: _Floats, values: _Floats, shape: NDArray[np.int64]) -> _Floats:
    """Distribute values over the eight grid points around each place."""
    cell = np.floor(places).astype(int)
    share = places - cell
    out = np.zeros((int(np.prod(shape)), values.shape[1]))
    for corner in itertools.product((0, 1), repeat=3):
        weight = np.prod(np.where(corner, share, 1 - share), 1)
        index = np.ravel_multi_index(tuple((cell + corner).T), tuple(shape))
        for axis in range(values.shape[1]):
            out[:, axis] += np.bincount(index, weight * values[:, axis], minlength=len(out))
    return out.reshape(*shape, -1)
