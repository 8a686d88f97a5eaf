"""Draw the source and the result of a pair with their textures, at one scale: three quarters from the front, a side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from meshdeform.assets import Limits, load_asset
from meshdeform.rendering.studio import Pose, Studio

SIDE = 320
AZIMUTHS_DEG = (35.0, 90.0)
"""From the asset's front."""


def draw(source: Path, result: Path, front_deg: float, folder: Path) -> None:
    """Write `source.png` and `result.png`, two views of `SIDE` pixels side by side, into a folder."""
    assets = [load_asset(path.read_bytes(), path.name, Limits.unlimited()) for path in (source, result)]
    poses = [Pose(each.surface.positions, each.surface.normals) for each in assets]
    azimuths = tuple(front_deg + each for each in AZIMUTHS_DEG)
    # The appearance is that of the source: a deformation changes neither triangles nor textures.
    studio = Studio(assets[0].appearance(), poses, size=SIDE, azimuths_deg=azimuths)
    for name, pose in zip(("source", "result"), poses, strict=True):
        views = np.concatenate(list(studio.photograph(pose, azimuths)), axis=1)
        Image.fromarray(views).save(folder / f"{name}.png")
