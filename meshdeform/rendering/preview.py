"""Draw `preview.png`: the asset before (upper row) and after (lower row), from four sides."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.appearance import Appearance
from meshdeform.rendering.studio import Pose, Studio

__all__ = ["comparison_png", "preview_png"]

_SIZE = 256
_AZIMUTHS_DEG = (30.0, 120.0, 210.0, 300.0)


def preview_png(appearance: Appearance, source: Pose, result: Pose) -> bytes:
    """Draw both states with the asset's colours and normals, at the same scale, so that growth is visible.

    Returns
    -------
    A PNG of 1024 x 512 pixels: front, left, back and right of the source above and of the result below.
    """
    studio = Studio(appearance, (source, result), size=_SIZE, azimuths_deg=_AZIMUTHS_DEG)
    rows = [np.concatenate(list(studio.photograph(pose, _AZIMUTHS_DEG)), 1) for pose in (source, result)]
    return _labelled(rows, ("source", "result"))


def comparison_png(glbs: Mapping[str, bytes]) -> bytes:
    """Draw assets that need not have the same triangles, one in each row under its name, from four sides."""
    rows = []
    for data in glbs.values():
        asset = load_asset(data, limits=Limits.unlimited())
        pose = Pose(asset.surface.positions, asset.surface.normals)
        studio = Studio(asset.appearance(), (pose,), size=_SIZE, azimuths_deg=_AZIMUTHS_DEG)
        rows.append(np.concatenate(list(studio.photograph(pose, _AZIMUTHS_DEG)), 1))
    return _labelled(rows, list(glbs))


def _labelled(rows: Sequence[NDArray[np.uint8]], labels: Sequence[str]) -> bytes:
    image = Image.fromarray(np.ascontiguousarray(np.concatenate(rows)), "RGB")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(13)
    for row, label in enumerate(labels):
        # At the end of the row: the web page shows its beginning as a thumbnail.
        draw.text((image.width - 9, row * _SIZE + 6), label, fill=(110, 112, 118), font=font, anchor="ra")
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()
