"""Write the surface of an asset as binary STL: its triangles where viewers show them, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshdeform.assets.asset import Asset
from meshdeform.assets.build import far_origin
from meshdeform.errors import AssetEmptyError

Up = Literal["y", "z"]
Unit = Literal["m", "cm", "mm"]
_PER_METRE: dict[Unit, float] = {"m": 1.0, "cm": 100.0, "mm": 1e3}
_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Stl:
    """A binary STL, and what is known about its surface."""

    data: bytes
    triangles: int
    closed: bool  # whether every edge belongs to two triangles that face the same way; corners at one place are one
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The point, in the file's unit and axes, that its places are relative to. It is not zero for a surface so far away
    that 32-bit floats, which the format has, would round it; the file's header names it, too."""


def write_stl(asset: Asset, up: Up = "y", unit: Unit = "m") -> Stl:
    """Write the triangles of an asset, skins in the pose of its nodes. The same asset gives the same bytes.

    `up`: the axis that points up. For `z`, the asset's front, +Z in glTF, becomes -Y. `unit`: of the lengths: the
    format stores none.
    """
    import trimesh

    shown = asset.surface
    if not len(shown.triangles):
        raise AssetEmptyError("The asset has no triangles that an STL could hold.")
    positions = shown.positions @ (_Z_UP.T if up == "z" else np.eye(3)) * _PER_METRE[unit]
    origin = far_origin([positions])
    if origin is not None:
        positions = positions - origin
    mesh = trimesh.Trimesh(positions, shown.triangles, process=False)
    data = mesh.export(file_type="stl")
    x, y, z = (0.0, 0.0, 0.0) if origin is None else origin.tolist()
    if origin is not None:
        data = f"places are relative to {x:.17g} {y:.17g} {z:.17g}".encode()[:80].ljust(80) + data[80:]
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return Stl(data, len(shown.triangles), bool(mesh.is_watertight and mesh.is_winding_consistent), (x, y, z))
