"""Find the closed surface of an oriented point cloud on a grid.

The function phi whose gradient is nearest to the smoothed field of normals solves a Poisson equation, here by FFT;
the surface is where it has its mean value over the points.

Source: Kazhdan 2005, Reconstruction of Solid Models from Oriented Point Sets.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

_Floats = NDArray[np.float64]
_MARGIN = 0.15
_NEIGHBOURS = 8
_SMOOTH_CELLS = 1.0
"""Standard deviation of the smoothing in cells; less lets the samples show, more rounds edges."""


def poisson_grid(points: _Floats, normals: _Floats, cells: int) -> tuple[_Floats, _Floats, float]:
    """Return phi (X, Y, Z), negative inside; the place (3,) of its first value; and the distance of neighbours.

    Parameters
    ----------
    points, normals : (P, 3) float64
        Unit normals, to the outside.
    cells : int
        Cells along the longest side.
    """
    low, high = points.min(0), points.max(0)
    size = float((high - low).max())
    spacing = size * (1 + 2 * _MARGIN) / cells
    shape = np.ceil((high - low + 2 * _MARGIN * size) / spacing).astype(int) + 1
    origin = (low + high) / 2 - spacing * (shape - 1) / 2
    # Each point stands for the area around it, so that denser parts do not count more.
    near, _ = cKDTree(points).query(points, k=min(_NEIGHBOURS, len(points)))
    areas = near[:, -1] ** 2
    field = _splat((points - origin) / spacing, normals * areas[:, None], shape)
    waves = [2 * np.pi * np.fft.fftfreq(n) for n in shape[:2]] + [2 * np.pi * np.fft.rfftfreq(shape[2])]
    k = np.stack(np.meshgrid(*waves, indexing="ij"))
    squared = (k**2).sum(0)
    squared[0, 0, 0] = 1.0
    blur = np.exp(-0.5 * _SMOOTH_CELLS**2 * squared)
    divergence = sum(1j * k[axis] * np.fft.rfftn(field[..., axis]) for axis in range(3))
    phi = np.fft.irfftn(-divergence * blur / squared, s=tuple(shape), axes=(0, 1, 2))
    at_points = map_coordinates(phi, ((points - origin) / spacing).T, order=1)
    return phi - np.average(at_points, weights=areas), origin, spacing


def _splat(places: _Floats, values: _Floats, shape: NDArray[np.int64]) -> _Floats:
    """Distribute values over the eight grid points around each place."""
    cell = np.floor(places).astype(int)
    share = places - cell
    out = np.zeros((int(np.prod(shape)), 3))
    for corner in itertools.product((0, 1), repeat=3):
        weight = np.prod(np.where(corner, share, 1 - share), 1)
        index = np.ravel_multi_index(tuple((cell + corner).T), tuple(shape))
        for axis in range(3):
            out[:, axis] += np.bincount(index, weight * values[:, axis], minlength=len(out))
    return out.reshape(*shape, 3)
