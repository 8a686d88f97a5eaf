"""Lay the controls of a request over where a fit takes a surface, which knows none of them.

What is kept, what is mirrored and the vertices on edges of other faces are placed as under an optimiser
(`meshdeform.deformation.constraints`).
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.geometry.mesh import RestMesh
from meshdeform.runs.control import Control

__all__ = ["controlled"]

_Floats = NDArray[np.float64]


def controlled(control: Control, mesh: RestMesh, verts: _Floats) -> _Floats:
    """Return vertices (V, 3) as the controls have them; what is kept has the bits of the mesh at rest."""
    placement = control.constraints.placement(mesh)
    return verts if placement is None else placement.place(torch.from_numpy(verts)).numpy()
