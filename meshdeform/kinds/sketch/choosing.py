"""Choose among assets by a drawing: those whose lines look most like it from some side.

Lines are drawn where the depth of the picture of an asset jumps, and where its surface bends. Lines and drawing are
compared by histograms of oriented gradients (Dalal and Triggs 2005), as Huang et al. 2017 compare theirs.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter1d

from meshdeform.assets import Asset
from meshdeform.assets.drawing import prepared, read_drawing
from meshdeform.rendering.cameras import Frame, fixed_cameras
from meshdeform.rendering.visibility import nearest_faces

_Floats = NDArray[np.float64]

_VIEWS = [(azimuth, elevation) for elevation in (3.0, 20.0, 38.0) for azimuth in range(-180, 180, 20)]
_FOV_DEG, _PIXELS = 25.0, 128
_JUMP, _BEND_COS, _BLUR = 0.01, 0.6, 1.0
_CELL, _BINS = 8, 9


def gradients(pictures: NDArray[np.float32]) -> _Floats:
    """Return histograms of oriented gradients (N, D) of pictures (N, S, S): unsigned, blocks of 2 x 2 cells."""
    dy, dx = (gaussian_filter1d(pictures.astype(np.float64), _BLUR, axis, order=1) for axis in (1, 2))
    size, place = np.hypot(dx, dy), np.mod(np.arctan2(dy, dx), np.pi) / np.pi * _BINS
    low, share = np.floor(place).astype(int) % _BINS, place - np.floor(place)
    count, side = len(pictures), pictures.shape[1] // _CELL
    parts = [size * ((low == b) * (1 - share) + ((low + 1) % _BINS == b) * share) for b in range(_BINS)]
    cells = np.stack([each.reshape(count, side, _CELL, side, _CELL).sum((2, 4)) for each in parts], -1)
    blocks = np.concatenate([cells[:, i : side - 1 + i, j : side - 1 + j] for i in (0, 1) for j in (0, 1)], -1)
    blocks /= np.linalg.norm(blocks, axis=-1, keepdims=True) + 0.1
    return np.asarray(blocks.reshape(count, -1))


def line_pictures(asset: Asset) -> NDArray[np.float32]:
    """Return the lines of an asset from many sides as `prepared` returns a drawing (54, SIDE, SIDE)."""
    positions = asset.surface.positions.astype(np.float64)
    verts = Frame.around(positions).enter(positions)
    faces = np.asarray(asset.surface.triangles, np.int64)
    azimuths, elevations = zip(*_VIEWS, strict=True)
    cameras = fixed_cameras(azimuths, elevations, _FOV_DEG)
    face, depth = nearest_faces(cameras.project(verts.astype(np.float32)), faces, _PIXELS, _PIXELS)
    corners = verts[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    normal, there = normals[np.maximum(face, 0)], face >= 0
    ink = np.zeros_like(there)
    for axis in (1, 2):
        other = np.roll(there, 1, axis)
        bend = (normal * np.roll(normal, 1, axis)).sum(-1) < _BEND_COS
        step = depth - np.roll(depth, 1, axis)  # a plane that is seen aslant has even steps
        ink |= (there != other) | (there & other & (bend | (np.abs(step - np.roll(step, 1, axis)) > _JUMP)))
    return np.stack([prepared(Image.fromarray(np.where(page, 0, 255).astype(np.uint8))) for page in ink])


def distances(drawing: bytes, assets: Iterable[Asset]) -> _Floats:
    """Return how far the lines of each asset, from the side where they are most alike, are from a drawing."""
    drawn_gradients = gradients(read_drawing(drawing)[None])
    return np.array([np.linalg.norm(gradients(line_pictures(each)) - drawn_gradients, axis=1).min() for each in assets])
