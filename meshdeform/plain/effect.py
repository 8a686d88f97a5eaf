"""Measure a change on its result: what was to grow, its other directions, and the rest.

Of the pieces of the part, with extents e before and e' after along an axis a, and for a vertex v of the rest that
moved by d, of which the change itself asks for the shift s (what stands or hangs on the part)::

    grown_a = mean over the pieces of log(e'_a / e_a)
    made    = mean of grown_a over the axes that were asked for, of log(asked)
    other   = max |grown_a| over the other axes
    rest    = max |d_v - s_v - median(d - s)| / diagonal
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshdeform.plain.body import Body, Floats
from meshdeform.plain.moved import MeasuredPiece, Moved

_HALF = 0.5
"""Share of what was asked for below which the result is doubtful."""
_MOST_OF_REST = 0.02
"""Share of the diagonal by which the rest may move."""
_OUTSIDE = 0.02
_FLAT = 1e-3
"""Extent, as a share of the greatest, of a piece that has none along an axis."""
_MORE, _NOTICED = 1.1, 0.02
"""Share of what was made, and change as the logarithm of a factor, from which another direction changed more: what is
bent grows in several."""


@dataclass(frozen=True)
class Effect:
    """What was measured of a change."""

    grown: float | None  # factor along the axes that were asked for; None if the part has no extent along them
    other: float  # factor along the axis among the others that changed most
    rest: float  # how far the rest moved, as a share of the diagonal

    def doubts(self, what: str, asked: float, word: str) -> list[str]:
        """Return sentences about what is less than was asked for, or more: of a part by its name, asked in a word."""
        found = []
        grown = 0.0 if self.grown is None else np.log(self.grown)
        if self.grown is not None and grown / np.log(asked) < _HALF:
            found.append(f"The {what} became {self.grown:.2f} times as {word}; {asked:.2f} was asked for.")
        if abs(np.log(self.other)) > _MORE * abs(grown) + _NOTICED:
            found.append(f"Another direction of the {what} changed more: it became {self.other:.2f} times as large.")
        if self.rest > _MOST_OF_REST:
            found.append(f"What does not belong to the {what} moved by up to {self.rest:.1%} of the diagonal.")
        return found


def measure(body: Body, moved: Moved, points: Floats) -> Effect:
    """Return what was measured; `moved`: what a map made of a body, and `points` (V, 3): what came of it in the end."""
    grown, other = _grown(body, moved.measured, points)
    outside = moved.weight < _OUTSIDE
    rest = 0.0
    if outside.any():
        left = (points - body.points - (0.0 if moved.shift is None else moved.shift))[outside]
        rest = float(np.linalg.norm(left - np.median(left, axis=0), axis=1).max()) / max(body.diagonal, 1e-300)
    return Effect(grown, other, rest)


def _grown(body: Body, measured: Sequence[MeasuredPiece], points: Floats) -> tuple[float | None, float]:
    """Return the factor along the axes that were asked for, and that along another which changed most."""
    asked, others = list[float](), list[float]()
    for number in range(3):
        logs = []
        for each in measured:
            before, after = each.extents(body.points), each.extents(points)
            if before[number] > _FLAT * before.max():
                logs.append((each.asked[number], float(np.log(max(after[number], 1e-300) / before[number]))))
        for wanted, found in ((True, asked), (False, others)):
            own = [value for is_asked, value in logs if is_asked == wanted]
            if own:
                found.append(float(np.mean(own)))
    most = max(others, key=abs, default=0.0)
    return float(np.exp(np.mean(asked))) if asked else None, float(np.exp(most))
