"""Draw `preview.png`: the asset before (upper row) and after (lower row), from four sides."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from meshdeform.assets.appearance import Appearance
from meshdeform.rendering.studio import Pose, Studio

__all__ = ["preview_png"]

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
    image = Image.fromarray(np.ascontiguousarray(np.concatenate(rows)), "RGB")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(13)
    for row, label in enumerate(("source", "result")):
        # At the end of the row: the web page shows its beginning as a thumbnail.
        draw.text((image.width - 9, row * _SIZE + 6), label, fill=(110, 112, 118), font=font, anchor="ra")
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()
