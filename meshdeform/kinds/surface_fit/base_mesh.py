"""Make the base: a coarse manifold mesh with the parts, handles and borders of the surface (`collapse`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetError
from meshdeform.kinds.surface_fit.cleaning import CleanMesh
from meshdeform.kinds.surface_fit.collapse import collapsed

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_MOST = 4
"""Times the faces that were asked for, at most."""


def base_of(surface: CleanMesh, count: int) -> tuple[_Floats, _Index]:
    """Return the vertices (V, 3) float64 and faces (F, 3) int64 of a base of at most `count` faces.

    It has more, up to four times as many, if fewer would fold over. A surface that has no more is its own base.

    Raises
    ------
    AssetError
        So few faces cannot have the handles, holes and parts of the surface.
    """
    known = surface.topology
    if known.fewest_faces <= count:
        verts, faces = collapsed(surface, count)
        if len(faces) <= _MOST * count:
            return verts, faces
    raise AssetError(
        f"The surface has {known.components} parts, {known.genus} handles and {known.borders} borders, which need a "
        f"base of {known.fewest_faces} faces or more; params.base_faces is {count}.",
        advice="Set it higher, or fill tiny holes and remove tiny handles and loose parts. A grid with noise, and "
        "points whose normals face anywhere, have hundreds of them.",
    )
