"""Write shapes side by side in one GLB: each coloured by part, and with its corresponding points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.container import Json
from meshdeform.assets.document import ELEMENT_ARRAY_BUFFER, Document
from meshdeform.assets.inspect import UNSIGNED_INT

_POINTS = 0
_APART = 1.15
"""Distance of two shapes in widths or heights of the largest one."""

_Colour = tuple[float, float, float, float]


@dataclass(frozen=True)
class WallShape:
    """A shape of a wall."""

    name: str
    positions: NDArray[np.float64]  # (N, 3) float64: around 0, +Y up, all shapes in one unit
    triangles: NDArray[np.int64]  # (F, 3) int64
    parts: NDArray[np.uint8]  # (F,) uint8: the part of each triangle
    points: NDArray[np.float64]
    """(K, 3) float64: in the frame of the positions; point k of one shape corresponds to point k of any other."""
    confidence: NDArray[np.float32]  # (K,) float32: how sure each point is; 0 where the shape lacks it


def wall_glb(shapes: Sequence[WallShape], parts: Sequence[str], colours: Sequence[_Colour], extras: Json) -> bytes:
    """Return a GLB with a node for each shape, in rows from the top left.

    The mesh of a node has a primitive for each part, whose material has the part's name and colour, and one of points
    with the attribute `_CONFIDENCE`.

    Parameters
    ----------
    colours : sequence of tuple
        Linear RGBA, taken in turn.
    extras : dict
        JSON for `asset.extras.meshdeform`.
    """
    about: Json = {"version": "2.0", "generator": f"Meshdeform {__version__}", "extras": {"meshdeform": extras}}
    root: Json = {"asset": about, "scene": 0, "scenes": [{"nodes": list(range(len(shapes)))}]}
    root |= {"nodes": [], "meshes": [], "materials": []}
    document = Document(root, None, b"")
    for number, part in enumerate(parts):
        colour = [float(value) for value in colours[number % len(colours)]]
        shading = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.8}
        root["materials"].append({"name": part, "pbrMetallicRoughness": shading})
    columns = max(math.ceil(math.sqrt(1.5 * len(shapes))), 1)
    sizes = np.array([np.ptp(shape.positions, axis=0) for shape in shapes])
    # A shape that is turned is as wide as it is deep.
    across, down = _APART * float(np.hypot(sizes[:, 0], sizes[:, 2]).max()), _APART * float(sizes[:, 1].max())
    for number, shape in enumerate(shapes):
        place = [number % columns * across, -(number // columns) * down, 0.0]
        root["nodes"].append({"name": shape.name, "mesh": number, "translation": place})
        primitives = [_surface(document, shape, int(part)) for part in np.unique(shape.parts)]
        root["meshes"].append({"name": shape.name, "primitives": [*primitives, _points(document, shape)]})
    return document.to_bytes()


def _surface(document: Document, shape: WallShape, part: int) -> dict[str, Any]:
    rows, corners = np.unique(shape.triangles[shape.parts == part], return_inverse=True)
    position = document.append_accessor(shape.positions[rows].astype(np.float32), bounds=True)
    view = document.append_view(corners.reshape(-1).astype("<u4").tobytes(), ELEMENT_ARRAY_BUFFER)
    accessors = document.items("accessors")
    accessors.append({"bufferView": view, "componentType": UNSIGNED_INT, "count": corners.size, "type": "SCALAR"})
    return {"attributes": {"POSITION": position}, "indices": len(accessors) - 1, "material": part}


def _points(document: Document, shape: WallShape) -> dict[str, Any]:
    position = document.append_accessor(shape.points.astype(np.float32), bounds=True)
    sure = document.append_accessor(shape.confidence.astype(np.float32))
    return {"attributes": {"POSITION": position, "_CONFIDENCE": sure}, "mode": _POINTS}
