"""How a value goes from its first to its last one over a run."""

from __future__ import annotations

import math

from meshdeform.requests.choices import Annealing

__all__ = ["annealed"]


def annealed(begin: float, end: float, fraction: float, kind: Annealing = Annealing.LINEAR) -> float:
    """The value at a fraction (0 .. 1) of the run.

    `cosine` stays near both ends longer than `linear`: ``end + (begin - end) (1 + cos(pi fraction)) / 2``. Source:
    Loshchilov and Hutter 2017, SGDR, eq. 5, with one period.
    """
    share = 0.5 * (1 - math.cos(math.pi * fraction)) if kind is Annealing.COSINE else fraction
    return begin + (end - begin) * share
