"""What a change makes of a body: its points, what was to grow, and along which axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshdeform.plain.body import UP, Body, Floats, Index
from meshdeform.plain.pieces import Piece

_X, _Z = 0, 2


@dataclass(frozen=True)
class MeasuredPiece:
    """A piece of what was to grow: its vertices, and the axes along which it is measured."""

    rows: Index
    axes: Floats  # (3, 3) float64: unit vectors, as rows
    asked: tuple[bool, bool, bool]  # along which of them it was to grow

    def extents(self, points: Floats) -> Floats:
        """Return its extent along each axis, (3,)."""
        return np.ptp(points[self.rows] @ self.axes.T, axis=0) if len(self.rows) else np.zeros(3)


@dataclass(frozen=True)
class Moved:
    """A body after a change."""

    points: Floats  # (V, 3) float64
    weight: Floats  # (V,) float64: how much each vertex belongs to the part
    length: Callable[[Floats], float]  # measures what was to grow, on any positions (V, 3) of the vertices
    found_by: str = ""  # how the part was found; empty for the whole
    measured: Sequence[MeasuredPiece] = ()  # the pieces of the part
    shift: Floats | None = None  # (V, 3) float64: how the change asks the rest to move; None if it is to stay
    affine: Floats | None = None  # (3, 4) float64: the map of all points, if it is one

    def extent(self, points: Floats) -> float:
        """Return the mean extent of the pieces along the axes that were asked for."""
        return mean_extent(self.measured)(points)


def frame(direction: str, body: Body, piece: Piece | None = None) -> tuple[Floats, tuple[bool, bool, bool]]:
    """Return the axes, as rows of (3, 3), that a direction of the table means, and which of them are asked for."""
    if direction in ("along", "girth") and piece is not None:
        return piece.axes, (True, False, False) if direction == "along" else (False, True, True)
    asked = {
        "up": {UP},
        "side": {body.lateral},
        "axle": {body.lateral},
        "front": {body.front},
        "level": {_X, _Z},
        "all": {_X, UP, _Z},
    }[direction]
    return np.eye(3), (_X in asked, UP in asked, _Z in asked)


def mean_extent(measured: Sequence[MeasuredPiece]) -> Callable[[Floats], float]:
    """Return the measure of pieces by their mean extent along the axes that were asked for."""
    return lambda at: float(np.mean([each.extents(at)[list(each.asked)].mean() for each in measured] or [0.0]))
