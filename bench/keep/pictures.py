"""Draw the source and the result of a pair with their textures: three quarters from the front, and from a side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from meshdeform.assets import Limits, load_asset
from meshdeform.rendering.studio import Studio, SurfaceState

SIDE = 320
AZIMUTHS_DEG = (35.0, 90.0)
"""From the asset's front."""


def draw(source: Path, result: Path, front_deg: float, folder: Path) -> None:
    """Write `source.png` and `result.png`, two views of `SIDE` pixels side by side, each as large as it fits."""
    assets = [load_asset(path.read_bytes(), path.name, Limits.unlimited()) for path in (source, result)]
    # A deformation changes neither triangles nor textures.
    appearance, azimuths = assets[0].appearance(), tuple(front_deg + each for each in AZIMUTHS_DEG)
    for name, asset in zip(("source", "result"), assets, strict=True):
        pose = SurfaceState(asset.surface.positions, asset.surface.normals)
        studio = Studio(appearance, (pose,), size=SIDE, azimuths_deg=azimuths)
        views = np.concatenate(list(studio.photograph(pose, azimuths)), axis=1)
        Image.fromarray(views).save(folder / f"{name}.png")
