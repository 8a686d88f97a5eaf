"""Lay the controls of a request over the displacements of a fit, which knows none of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.mesh import RestMesh
from meshdeform.rendering.cameras import Frame
from meshdeform.runs.control import Control

__all__ = ["controlled", "is_free"]

_Floats = NDArray[np.float64]


def is_free(control: Control) -> bool:
    """Return whether nothing is asked of where the surface goes."""
    constraints = control.constraints
    return constraints.freedom is None and not constraints.handles and not control.bodies and control.partners is None


def controlled(control: Control, _frame: Frame, mesh: RestMesh, verts: _Floats) -> _Floats:
    """Return vertices (V, 3) as the controls have them; what is kept has the bits of the mesh at rest."""
    rest = mesh.verts.numpy()
    freedom = control.constraints.freedom
    if freedom is None:
        return verts
    moves = (freedom**2 * (3 - 2 * freedom))[:, None] * (verts - rest)
    return np.where((freedom == 0)[:, None], rest, rest + moves)
