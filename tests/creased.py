"""A square with a narrow strip at its border, bent up: where a large face and a crease meet."""

from __future__ import annotations

import math

import numpy as np

from meshdeform.geometry.mesh import TriangleMesh

__all__ = ["creased"]

_FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 5], [0, 5, 3]])


def creased(degrees: float) -> TriangleMesh:
    """Return a square of side 1 and a strip a twentieth as wide, with this dihedral angle between them: 4 faces."""
    angle, wide = math.radians(degrees), 0.05
    rise = [-wide * math.cos(angle), wide * math.sin(angle)]
    square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
    return TriangleMesh(np.array([*square, [*rise, 0.0], [*rise, 1.0]]), _FACES)
