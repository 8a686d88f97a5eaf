"""Draw the lines of a surface: where its outline is, where something stands before something, where parts meet.

Lines are found in a picture of the nearest faces, not on the mesh: a member of a noun is a heap of closed solids that
run into each other, and only the picture tells which of their edges are seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.drawing import MARGIN, SIDE
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.visibility import nearest_faces

__all__ = ["BEND", "BORDER", "OUTLINE", "STEP", "View", "line_pictures"]

OUTLINE, STEP, BORDER, BEND = 1, 2, 4, 8
"""Bits of a pixel: the whole ends here, it lies deeper beyond, another part begins, the surface bends."""
_FOV_DEG = 25.0
_JUMP, _STEEPER = 0.02, 3.0
"""Difference of depth that is a step, if it is so many times that beside it: a plane seen aslant has even steps."""
_BEND_COS = 0.75
_LEAST_SHARE = 0.3
"""Share of the largest view's box below which a view shows too little: nobody draws a plate from the side."""

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
Pictures = NDArray[np.uint8]


@dataclass(frozen=True)
class View:
    """From where a drawing is made: azimuth and elevation in degrees; then turned on the page and made wider."""

    azimuth_deg: float
    elevation_deg: float
    turn: float = 0.0  # in radians
    wider: float = 1.0


def line_pictures(
    verts: Floats, faces: Index, parts: Index, views: Sequence[View], pixels: int = SIDE
) -> list[tuple[View, Pictures]]:
    """Return the lines of a surface from each view that shows enough of it, (pixels, pixels) uint8.

    `verts` (V, 3), `faces` (F, 3); `parts` (F,): the part of each face. The lines fill the page as those of a drawing
    that was `prepared`.
    """
    middle = (verts.max(0) + verts.min(0)) / 2
    centred = verts - middle
    centred /= max(float(np.linalg.norm(centred, axis=1).max()), 1e-12)
    azimuths, elevations = zip(*((each.azimuth_deg, each.elevation_deg) for each in views), strict=True)
    clip = fixed_cameras(azimuths, elevations, _FOV_DEG).project(centred.astype(np.float32))
    corners = centred[faces].astype(np.float32)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    places = clip[..., :2] / clip[..., 3:]
    sizes = np.ptp(places, axis=1).prod(1)
    shown = np.flatnonzero(sizes >= _LEAST_SHARE * sizes.max()).tolist()
    pages = [_lines(_framed(clip[k], places[k], views[k]), faces, normals, parts, pixels) for k in shown]
    return [(views[k], page) for k, page in zip(shown, pages, strict=True)]


def _framed(clip: NDArray[np.float32], places: NDArray[np.floating], view: View) -> NDArray[np.float32]:
    """Return places in clip space so that they fill the page."""
    cos, sin = np.cos(view.turn), np.sin(view.turn)
    places = places @ np.array([[cos, sin], [-sin, cos]]) * np.array([view.wider, 1 / view.wider])
    low, high = places.min(0), places.max(0)
    places = (places - (low + high) / 2) * (2 / (1 + 2 * MARGIN) / max(float((high - low).max()), 1e-12))
    return np.concatenate([places * clip[:, 3:], clip[:, 2:]], 1).astype(np.float32)


def _lines(
    clip: NDArray[np.float32], faces: Index, normals: NDArray[np.float32], parts: Index, pixels: int
) -> Pictures:
    """Return the lines (pixels, pixels) of faces, of which places in clip space are given."""
    face, depth = (each[0] for each in nearest_faces(clip[None], faces, pixels, pixels))
    there, known = face >= 0, np.maximum(face, 0)
    normal, part = normals[known], parts[known]
    page = np.zeros((pixels, pixels), np.uint8)
    for axis in (0, 1):
        other = np.roll(there, 1, axis)
        both = there & other
        step = np.abs(depth - np.roll(depth, 1, axis))
        beside = np.minimum(np.roll(step, 1, axis), np.roll(step, -1, axis))
        page |= OUTLINE * (there != other).astype(np.uint8)
        page |= STEP * (both & (step > _JUMP) & (step > _STEEPER * beside + _JUMP / 2)).astype(np.uint8)
        page |= BORDER * (both & (part != np.roll(part, 1, axis))).astype(np.uint8)
        page |= BEND * (both & ((normal * np.roll(normal, 1, axis)).sum(-1) < _BEND_COS)).astype(np.uint8)
    return page
