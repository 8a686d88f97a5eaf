"""Choose among assets by a drawing: those whose lines look most like it from some side."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.assets.drawing import read_drawing
from meshdeform.kinds.sketch.lines import View, line_pictures
from meshdeform.kinds.sketch.looking import gradients, inked

_VIEWS = [View(azimuth, elevation) for elevation in (3.0, 20.0, 38.0) for azimuth in range(-180, 180, 20)]


def distances(drawing: bytes, assets: Iterable[Asset]) -> NDArray[np.float64]:
    """Return how far the lines of each asset, from the side where they are most alike, are from a drawing.

    Their gradients are compared, as Huang et al. 2017 ("Shape Synthesis from Sketches") compare theirs.
    """
    drawn = gradients(read_drawing(drawing)[None])
    return np.array([np.linalg.norm(gradients(_lines(each)) - drawn, axis=1).min() for each in assets])


def _lines(asset: Asset) -> NDArray[np.float32]:
    """Return the lines of an asset from many sides (N, SIDE, SIDE)."""
    faces = np.asarray(asset.surface.triangles, np.int64)
    pictures = line_pictures(asset.surface.positions.astype(np.float64), faces, np.zeros(len(faces), np.int64), _VIEWS)
    return np.stack([inked(page) for _, page in pictures])
