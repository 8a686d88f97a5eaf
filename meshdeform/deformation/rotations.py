"""The rotation closest to each of many 3x3 matrices: the polar part that rigidity is measured from.

::

    omega = sum_k r_k x a_k / (|sum_k r_k . a_k| + 1e-9)        R <- exp(omega) R

with r_k and a_k the columns of R and of the matrix, from the identity until it stands still. It needs no singular
values, always gives a proper rotation (a reflected face is still compared with one), and is a few times faster than a
singular value decomposition.

Source: Mueller et al. 2016, A robust method to extract the rotational part of deformations, eq. 7 and algorithm 1.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["closest_rotations"]

_ITERATIONS = 60
_STILL = 1e-9

_Floats = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _turn(rotation: _Floats, axis: _Floats, angle: float) -> None:
    """Rotate the columns about an axis of unit length (Rodrigues)."""
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y, z = axis
    for k in range(3):
        a, b, c = rotation[0, k], rotation[1, k], rotation[2, k]
        along = (x * a + y * b + z * c) * (1 - cosine)
        rotation[0, k] = a * cosine + (y * c - z * b) * sine + x * along
        rotation[1, k] = b * cosine + (z * a - x * c) * sine + y * along
        rotation[2, k] = c * cosine + (x * b - y * a) * sine + z * along


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _extract(matrices: _Floats, rotations: _Floats) -> None:
    axis = np.empty(3)
    for f in range(len(matrices)):
        m, r = matrices[f], rotations[f]
        for _ in range(_ITERATIONS):
            axis[:] = 0.0
            along = 0.0
            for k in range(3):
                axis[0] += r[1, k] * m[2, k] - r[2, k] * m[1, k]
                axis[1] += r[2, k] * m[0, k] - r[0, k] * m[2, k]
                axis[2] += r[0, k] * m[1, k] - r[1, k] * m[0, k]
                along += r[0, k] * m[0, k] + r[1, k] * m[1, k] + r[2, k] * m[2, k]
            length = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
            angle = length / (abs(along) + 1e-9)
            if angle < _STILL:
                break
            _turn(r, axis / length, angle)


def closest_rotations(matrices: Tensor) -> Tensor:
    """The rotations R that minimise ||A - R||.

    Parameters
    ----------
    matrices : (F, 3, 3) float64

    Returns
    -------
    (F, 3, 3) float64, without gradient: the derivative of ||A - R(A)||^2 is 2 (A - R) all the same, for R is where
    the distance is least.
    """
    rotations = np.broadcast_to(np.eye(3), matrices.shape).copy()
    _extract(np.ascontiguousarray(matrices.detach().numpy()), rotations)
    return torch.from_numpy(rotations)
