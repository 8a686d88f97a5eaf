"""Measure what a sentence made of an asset, by the list's own parts; nothing that makes changes is asked.

Of each piece P of a part, with extents e_a(P) along the axes a::

    factor   = e_a(P after) / e_a(P before),  the mean over the pieces
    share    = log factor / log wanted        1 if all of it was made
    others   = max |log factor_b| / |log wanted|   over the axes b that were not asked for
    rest     = share of the other vertices that moved by more than 2 % of the diagonal, but for a shift of their piece
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.plain.assets import Wanted

__all__ = ["Found", "judged", "outside"]

UP = 1
_LEAST, _MOST = 0.5, 1.6
"""Shares of what was asked for, between which it counts as made."""
_OTHERS = 0.5
"""Share of the change that another direction may change by; of what is longer and bent, as much as it."""
_MOVED, _FEW = 0.02, 0.05
"""Share of the diagonal that the rest may move by, and of its vertices that may move by more: hand-made borders."""
_SHIFT = 0.1
_UPRIGHT = ("leg", "legs", "belly", "neck", "thighs")
_Floats = NDArray[np.float64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Found:
    """What was measured of one sentence."""

    made: bool  # whether it is what was wanted
    figures: str  # in words


def outside(wanted: Sequence[Wanted], pieces: dict[str, list[_Flags]]) -> _Flags:
    """Return the vertices (N,) that belong to none of the parts that are wanted."""
    return np.asarray(~np.logical_or.reduce([piece for each in wanted for piece in pieces[each.part]]))


def judged(
    wanted: Sequence[Wanted],
    pieces: dict[str, list[_Flags]],
    rest: Sequence[_Flags],
    front: str,
    before: _Floats,
    after: _Floats,
) -> Found:
    """Return whether what was wanted was made.

    `pieces`: the vertices (N,) of each piece of every part that is wanted; `rest`: those of each piece of the others;
    `before` and `after`: (N, 3) float64.
    """
    made, figures = True, []
    loose = any(each.part == "whole" and not each.direction for each in wanted)
    for each in wanted:
        if not each.direction:
            continue
        good, alone, told = _part(each, pieces[each.part], "XYZ".index(front[1]), before, after)
        made &= good and (alone or loose)
        figures.append(f"{each.part} {told}")
    if rest:
        moved = _rest(rest, before, after)
        made &= moved <= _FEW
        figures.append(f"rest {moved:.0%}")
    return Found(made, ", ".join(figures))


def _part(
    wanted: Wanted, pieces: Sequence[_Flags], front: int, before: _Floats, after: _Floats
) -> tuple[bool, bool, str]:
    """Return whether a part changed as was wanted, and no other direction of it, and its figures."""
    sizes = np.array([np.ptp(before[piece], axis=0) for piece in pieces])
    grown = np.array([np.ptp(after[piece], axis=0) for piece in pieces])
    full_sized = sizes > 1e-3 * sizes.max(1, keepdims=True)  # a pane has no thickness that could grow
    logs = np.log(np.maximum(grown, 1e-12) / np.maximum(sizes, 1e-12)) * full_sized
    factors = np.exp(logs.sum(0) / np.maximum(full_sized.sum(0), 1))
    flat = ~full_sized.any(0)
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
    most = max(1.0, *shares) if wanted.direction == "along" and shares else _OTHERS
    return good, all(other <= most for other in others), told


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


def _rest(rest: Sequence[_Flags], before: _Floats, after: _Floats) -> float:
    """Return the share of the rest that moved, but for a shift of each piece by a tenth of the diagonal at most.

    One shift of all may be larger: what stands on longer legs is lifted.
    """
    diagonal = float(np.linalg.norm(np.ptp(before, axis=0)))
    moved = after - before
    everything = np.logical_or.reduce(rest)
    far = everything & (np.linalg.norm(moved, axis=1) > 0.005 * diagonal)
    common = np.median(moved[far], axis=0) if far.any() else np.zeros(3)
    count = 0
    for piece in rest:
        own = np.median(moved[piece], axis=0)
        shifts = [np.zeros(3), common, own if np.linalg.norm(own) < _SHIFT * diagonal else common]
        left = np.min([np.linalg.norm(moved[piece] - shift, axis=1) for shift in shifts], axis=0)
        count += int((left > _MOVED * diagonal).sum())
    return count / max(int(everything.sum()), 1)
