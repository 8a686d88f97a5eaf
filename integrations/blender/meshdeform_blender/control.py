"""Say where meshes may deform: vertex groups as regions, empties as handles. Uses numpy, but not bpy.

Faces are numbered as in the file that `write_glb` writes: the triangles of all parts, one part after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import AddonError
from .glb import Part

__all__ = ["THRESHOLD", "handle_document", "region_documents"]

THRESHOLD = 0.5
_MAX_RANGES = 20_000


def region_documents(
    parts: Sequence[Part], weights: Sequence[NDArray[np.float32] | None], group: str, action: str
) -> list[dict[str, Any]]:
    """Return `params.control.regions` for a vertex group.

    Parameters
    ----------
    weights : sequence of (N,) float32 or None
        Weight of each vertex of each part in the group; None where the part has no such group.
    group : str
        Its name, for errors.
    """
    flags = [
        np.zeros(len(part.triangles), bool) if weight is None else (weight > THRESHOLD)[part.triangles].all(1)
        for part, weight in zip(parts, weights, strict=True)
    ]
    ranges = _ranges(np.concatenate(flags))
    if not ranges:
        raise AddonError(
            f"No face of the selected objects is in the vertex group “{group}” with a weight above {THRESHOLD:g}.",
            "Assign faces to it, or choose another group.",
        )
    if len(ranges) > _MAX_RANGES:
        raise AddonError(f"The faces of “{group}” are too scattered.", "Smooth its weights, or group larger patches.")
    return [{"faces": ranges, "action": action}]


def handle_document(start: Sequence[float], now: Sequence[float], weight: float = 1.0) -> dict[str, Any]:
    """Return a member of `params.control.handles` for an empty that was added at `start` and is `now` elsewhere."""
    document = {"position": _upright(start), "to": _upright(now)}
    return document if weight >= 1.0 else {**document, "weight": float(weight)}


def _upright(place: Sequence[float]) -> list[float]:
    """Return a place in the file's world, whose +Y is Blender's +Z."""
    x, y, z = (float(value) for value in place)
    return [x, z, -y]


def _ranges(flags: NDArray[np.bool_]) -> list[int | list[int]]:
    """Return the numbers of the set flags: single ones, and ranges with both ends."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    pairs = zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True)
    return [first if first == last else [first, last] for first, last in pairs]
