"""Solve positive definite systems about, by conjugate gradients scaled by the diagonal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["conjugate_gradients"]

_Reals = NDArray[np.floating[Any]]


def conjugate_gradients(
    apply: Callable[[_Reals], _Reals], diagonal: _Reals, right: _Reals, *, steps: int, enough: float
) -> _Reals:
    """Return about the solution x (N,) of A x = right, in the precision of `right`.

    Parameters
    ----------
    apply : callable
        Returns A times an array (N,).
    diagonal, right : arrays (N,) of float32 or float64
        That of A, positive, and the right side.
    steps : int
        The most that are taken.
    enough : float
        Share of the squared residual at the start, scaled by the diagonal, below which no further one is.
    """
    found, left = np.zeros_like(right), right.copy()
    scaled = left / diagonal
    direction = scaled.copy()
    size = first = float(left @ scaled)
    for _ in range(steps if first > 0 else 0):
        image = apply(direction)
        length = right.dtype.type(size / float(direction @ image))
        found += length * direction
        left -= length * image
        scaled = left / diagonal
        now = float(left @ scaled)
        if now < enough * first:
            break
        direction = scaled + right.dtype.type(now / size) * direction
        size = now
    return found
