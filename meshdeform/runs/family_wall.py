"""Make the wall of a family: its shapes side by side, light enough for a browser."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets.wall import WallShape, wall_glb
from meshdeform.families.members import turned
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.simplify import simplified
from meshdeform.runs.base import ArtifactData
from meshdeform.runs.family_picture import COLOURS

__all__ = ["shown", "wall", "wall_shape"]

_MOST_SHAPES = 120
_TRIANGLES, _OF_ONE = 150_000, 3_000
"""Triangles of a whole wall, and of one shape at most."""
_LEAST = 12


def shown(count: int) -> range:
    """Return which of `count` shapes a wall shows: all, or every second, third ... one."""
    return range(0, count, -(-count // _MOST_SHAPES))


def wall(
    shapes: Sequence[WallShape], parts: Sequence[str], labels: NDArray[np.int64], count: int | None = None
) -> ArtifactData:
    """Return the artifact `wall.glb`.

    Parameters
    ----------
    shapes : sequence of WallShape
    parts : sequence of str
    labels : (K,) int64
        The part of each point.
    count : int, optional
        Number of shapes with those that are not shown. Default: all are shown.
    """
    points = [int(label) for label in labels]
    about: dict[str, Any] = {"kind": "family_wall", "parts": list(parts), "points": points}
    about["shapes"] = len(shapes) if count is None else count
    return ArtifactData(wall_glb(shapes, parts, COLOURS, about), "model/gltf-binary")


def wall_shape(
    name: str,
    positions: NDArray[np.float64],
    triangles: NDArray[np.int64],
    parts: NDArray[np.uint8],
    points: NDArray[np.float64],
    confidence: NDArray[np.float32],
    *,
    centre: NDArray[np.float64],
    diagonal: float,
    turn: float,
    count: int,
) -> WallShape:
    """Return one of `count` shapes of a wall, with few triangles.

    Parameters
    ----------
    name : str
    positions : (N, 3) float64
        In the asset's units.
    triangles : (F, 3) int64
    parts : (F,) uint8
    points : (K, 3) float64
        In the family's frame: turned, around 0, with the diagonal as unit.
    confidence : (K,) float32
    centre, diagonal, turn
        Lead from the asset's units to that frame.
    count : int
    """
    verts = turned((positions - centre) / diagonal, turn)
    share = min(_OF_ONE, _TRIANGLES // count) / max(len(triangles), 1)
    pieces = []
    for part in np.unique(parts):
        piece = _welded(verts, triangles[parts == part])
        wanted = max(int(share * len(piece.faces)), _LEAST)
        less = simplified(piece, wanted) if len(piece.faces) > wanted and share < 1 else piece
        pieces.append((less if len(less.faces) else piece, part))
    starts = np.cumsum([0, *(len(piece.verts) for piece, _ in pieces)])
    return WallShape(
        name,
        np.concatenate([piece.verts.numpy() for piece, _ in pieces]),
        np.concatenate([piece.faces.numpy() + start for (piece, _), start in zip(pieces, starts, strict=False)]),
        np.concatenate([np.full(len(piece.faces), part, np.uint8) for piece, part in pieces]),
        points,
        confidence,
    )


def _welded(verts: NDArray[np.float64], faces: NDArray[np.int64]) -> TriangleMesh:
    """Return the triangles with one vertex at each place: across seams nothing could be collapsed."""
    places, rows = np.unique(verts[faces.reshape(-1)], axis=0, return_inverse=True)
    return TriangleMesh(torch.from_numpy(places), torch.from_numpy(rows.reshape(-1, 3).astype(np.int64)))
