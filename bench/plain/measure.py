"""Measure what a sentence made of an asset, by the list's own parts; nothing that makes changes is asked.

Of each piece P of a part, with extents e_a(P) along the axes a::

    factor   = e_a(P after) / e_a(P before),  the mean over the pieces
    share    = log factor / log wanted        1 if all of it was made
    others   = max |log factor_b| / |log wanted|   over the axes b that were not asked for
    rest     = share of the other vertices that moved by more than 2 % of the diagonal, but for one common shift
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.plain.assets import Wanted

__all__ = ["Found", "judged"]

UP = 1
_LEAST, _MOST = 0.5, 1.6
"""Shares of what was asked for, between which it counts as made."""
_OTHERS = 0.5
"""Share of the change that another direction may change by."""
_MOVED, _FEW = 0.02, 0.05
"""Share of the diagonal that the rest may move by, and of its vertices that may move by more: hand-made borders."""
_UPRIGHT = ("leg", "legs", "belly", "neck", "thighs")
_Floats = NDArray[np.float64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Found:
    """What was measured of one sentence."""

    made: bool  # whether it is what was wanted
    figures: str  # in words


def judged(
    wanted: Sequence[Wanted], pieces: dict[str, list[_Flags]], front: str, before: _Floats, after: _Floats
) -> Found:
    """Return whether what was wanted was made.

    `pieces`: the vertices (N,) of each piece of every part that is wanted; `before` and `after`: (N, 3) float64.
    """
    made, figures = True, []
    loose = any(each.part == "whole" and not each.direction for each in wanted)
    for each in wanted:
        if not each.direction:
            continue
        good, alone, told = _part(each, pieces[each.part], "XYZ".index(front[1]), before, after)
        made &= good and (alone or loose)
        figures.append(f"{each.part} {told}")
    everything = any(each.part == "whole" for each in wanted)
    if not everything:
        outside = ~np.logical_or.reduce([piece for each in wanted for piece in pieces[each.part]])
        moved = _rest(before[outside], after[outside], float(np.linalg.norm(np.ptp(before, axis=0))))
        made &= moved <= _FEW
        figures.append(f"rest {moved:.0%}")
    return Found(made, ", ".join(figures))


def _part(
    wanted: Wanted, pieces: Sequence[_Flags], front: int, before: _Floats, after: _Floats
) -> tuple[bool, bool, str]:
    """Return whether a part changed as was wanted, and no other direction of it, and its figures."""
    sizes = np.array([np.ptp(before[piece], axis=0) for piece in pieces])
    grown = np.array([np.ptp(after[piece], axis=0) for piece in pieces])
    factors = np.exp(np.log(np.maximum(grown, 1e-12) / np.maximum(sizes, 1e-12)).mean(0))
    flat = sizes.max(0) < 1e-3 * sizes.max()  # a plate has no thickness that could grow
    full = abs(np.log(wanted.factor))
    told = " x ".join(f"{factor:.2f}" for factor in factors)
    if wanted.direction == "height":
        heights = [np.mean([at[piece, UP].mean() for piece in pieces]) - at[:, UP].min() for at in (before, after)]
        share = float(np.log(heights[1] / heights[0]) / np.log(wanted.factor))
        largest = float(np.abs(np.log(factors)).max())
        return _LEAST <= share <= _MOST, largest < 0.1, f"height {heights[1] / heights[0]:.2f}, {told}"
    asked = _axes(wanted, sizes.mean(0), front)
    shares = [float(np.log(factors[axis]) / np.log(wanted.factor)) for axis in asked if not flat[axis]]
    others = [float(abs(np.log(factors[axis])) / full) for axis in range(3) if axis not in asked and not flat[axis]]
    good = bool(shares) and all(_LEAST <= share <= _MOST for share in shares)
    return good, all(other <= _OTHERS for other in others), told


def _axes(wanted: Wanted, size: _Floats, front: int) -> list[int]:
    """Return the axes that a direction means for a piece of a size (3,)."""
    long = UP if wanted.part.split()[-1] in _UPRIGHT else int(np.argmax(size))
    return {
        "tall": [UP],
        "deep": [front],
        "wide": [2 - front],
        "along": [int(np.argmax(size))],
        "thin": [int(np.argmin(size))],
        "girth": [axis for axis in range(3) if axis != long],
        "round": [0, 2],
        "size": [0, 1, 2],
    }[wanted.direction]


def _rest(before: _Floats, after: _Floats, diagonal: float) -> float:
    """Return the share of vertices that moved, but for one shift in common."""
    moved = after - before
    far = np.linalg.norm(moved, axis=1) > 0.005 * diagonal
    if not far.any():
        return 0.0
    shift = np.median(moved[far], axis=0)
    left = np.minimum(np.linalg.norm(moved, axis=1), np.linalg.norm(moved - shift, axis=1))
    return float((left > _MOVED * diagonal).mean())
