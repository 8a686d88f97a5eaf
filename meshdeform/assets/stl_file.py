"""Write what a scene shows as binary STL: its triangles, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshdeform.assets.build import far_origin
from meshdeform.assets.frame import FileFrame
from meshdeform.assets.scene import Scene
from meshdeform.errors import AssetEmptyError


@dataclass(frozen=True)
class Stl:
    """A binary STL, and what is known about its surface."""

    data: bytes
    triangles: int
    closed: bool  # whether every edge belongs to two triangles that face the same way; corners in one position are one
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The point, in the file's unit and axes, that its positions are relative to. Not zero for a surface so far away
    that 32-bit floats, which the format has, would round it; the file's header names it, too."""


def write_stl(scene: Scene, frame: FileFrame) -> Stl:
    """Write the triangles of a scene. The same scene gives the same bytes. Raises AssetEmptyError: it has none."""
    import trimesh

    pieces = list(scene.placed())
    if not pieces:
        raise AssetEmptyError("The asset has no triangles that an STL could hold.")
    scene.lost["materials"] += len({piece.material for piece in pieces} - {None})
    scene.lost["colours of vertices"] += sum(piece.colors is not None for piece in pieces)
    positions = frame.points(np.concatenate([piece.positions for piece in pieces]))
    starts = np.cumsum([0, *(len(piece.positions) for piece in pieces)])
    triangles = np.concatenate([start + piece.triangles for start, piece in zip(starts, pieces, strict=False)])
    origin = far_origin([positions])
    if origin is not None:
        positions = positions - origin
    mesh = trimesh.Trimesh(positions, triangles, process=False)
    data = mesh.export(file_type="stl")
    x, y, z = (0.0, 0.0, 0.0) if origin is None else origin.tolist()
    if origin is not None:
        data = f"places are relative to {x:.17g} {y:.17g} {z:.17g}".encode()[:80].ljust(80) + data[80:]
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return Stl(data, len(triangles), bool(mesh.is_watertight and mesh.is_winding_consistent), (x, y, z))
