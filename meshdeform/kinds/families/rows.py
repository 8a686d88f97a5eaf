"""Stand shapes in rows with few triangles, in the colours of their parts: what a checkpoint of a family's run shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset, Primitive, build_glb
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import simplified
from meshdeform.runs.sheets import COLOURS

__all__ = ["StandingShape", "in_rows", "simple_surface", "standing_shape", "without_seams"]

_TRIANGLES = 600
_APART = 1.3
"""Distance of two shapes in units of the largest extent."""


@dataclass(frozen=True)
class StandingShape:
    """A shape with the part of each triangle."""

    name: str
    verts: NDArray[np.float64]  # (N, 3) float64: +Y up, all shapes in one unit
    faces: NDArray[np.int64]  # (F, 3) int64
    parts: NDArray[np.int64]  # (F,) int64


def without_seams(verts: NDArray[np.float64], faces: NDArray[np.int64]) -> TriangleMesh:
    """Return triangles (F, 3) with one vertex at each place: across seams nothing could be collapsed."""
    places, rows = np.unique(verts[faces.reshape(-1)], axis=0, return_inverse=True)
    return TriangleMesh(places, rows.reshape(-1, 3).astype(np.int64))


def simple_surface(asset: Asset, chosen: NDArray[np.bool_] | None = None) -> TriangleMesh:
    """Return the surface of an asset, or the chosen ones of its triangles (F,), with few triangles.

    The asset is around 0, and its diagonal the unit.
    """
    verts, faces = asset.surface.positions, asset.surface.triangles
    low, high = verts[faces].min((0, 1)), verts[faces].max((0, 1))
    scale = float(np.linalg.norm(high - low)) or 1.0
    mesh = without_seams((verts - (low + high) / 2) / scale, faces if chosen is None else faces[chosen])
    less = simplified(mesh, _TRIANGLES) if len(mesh.faces) > _TRIANGLES else mesh
    return less if len(less.faces) else mesh


def standing_shape(name: str, asset: Asset, parts: Sequence[str]) -> StandingShape:
    """Return an asset whose nodes have the names of its parts."""
    known = asset.pieces()
    meshes = [simple_surface(asset, known.in_node(node["index"])) for node in known.nodes]
    starts = np.cumsum([0, *(len(mesh.verts) for mesh in meshes)])
    return StandingShape(
        name,
        np.concatenate([mesh.verts for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
        np.repeat([parts.index(node["name"]) for node in known.nodes], [len(mesh.faces) for mesh in meshes]),
    )


def in_rows(shapes: Sequence[StandingShape], parts: Sequence[str]) -> bytes:
    """Return a GLB of shapes in rows from the top left; each part of each is a node by its name and the part's."""
    columns = max(math.ceil(math.sqrt(1.5 * len(shapes))), 1)
    extents = np.array([np.ptp(shape.verts, axis=0) for shape in shapes])
    across, down = _APART * float(extents[:, [0, 2]].max()), _APART * float(extents[:, 1].max())
    pieces = []
    for number, shape in enumerate(shapes):
        place = np.array([number % columns * across, -(number // columns) * down, 0.0])
        for part in np.unique(shape.parts):
            rows, corners = np.unique(shape.faces[shape.parts == part], return_inverse=True)
            pieces.append(
                Primitive(
                    shape.verts[rows] + place,
                    corners.reshape(-1, 3),
                    name=f"{shape.name}: {parts[part]}",
                    material=parts[part],
                    base_color=COLOURS[part % len(COLOURS)],
                )
            )
    return build_glb(pieces)
