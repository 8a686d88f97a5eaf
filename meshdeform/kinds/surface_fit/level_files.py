"""Write an unfolded level as a GLB, and its intrinsic triangulation as an NPZ. numpy only."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.build import build_glb

if TYPE_CHECKING:
    from meshdeform.kinds.surface_fit.intrinsic import IntrinsicMesh

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


def level_glb(verts: _Floats, faces: _Index, colours: NDArray[np.uint8] | None = None) -> bytes:
    """Write a mesh with smooth normals, and sRGB colours (V, 3) of its vertices if there are any, as a GLB."""
    return build_glb(verts, faces, normals=smooth_normals(verts, faces), colors=colours)


def smooth_normals(verts: _Floats, faces: _Index) -> _Floats:
    """Return the unit normals (V, 3) of vertices: means of those of the faces around, by area."""
    corners = verts[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out = np.zeros_like(verts)
    for k in range(3):
        for axis in range(3):
            out[:, axis] += np.bincount(faces[:, k], cross[:, axis], len(verts))
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return np.where(length > 0, out / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])


def intrinsic_npz(mesh: IntrinsicMesh, verts: _Floats) -> bytes:
    """Write `faces` (F, 3), `lengths` (F, 3) of the sides, `verts` (V, 3), and the certificate as an NPZ."""
    out = io.BytesIO()
    np.savez_compressed(
        out, faces=mesh.faces.astype(np.int32), lengths=mesh.lengths, verts=verts, least_cotangent_sum=mesh.least
    )
    return out.getvalue()
