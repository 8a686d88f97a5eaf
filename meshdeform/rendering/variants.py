"""Draw variants of an asset as one sheet, a row for each seed and a column for each strength."""

from __future__ import annotations

import io
from collections.abc import Sequence

from PIL import Image, ImageDraw, ImageFont

from meshdeform.geometry.appearance import Appearance
from meshdeform.rendering.studio import Pose, Studio

_TITLE, _FRONT_DEG = 24, 30.0


def variant_sheet(
    appearance: Appearance,
    poses: Sequence[Sequence[Pose]],
    rows: Sequence[str],
    columns: Sequence[str],
    *,
    size: int = 224,
) -> bytes:
    """Return a PNG with all poses at the same scale.

    Parameters
    ----------
    poses : sequence of sequences of Pose
        One for each column, for each row.
    size : int
        Side of each picture, in pixels.
    """
    every = tuple(pose for row in poses for pose in row)
    studio = Studio(appearance, every, size=size, azimuths_deg=[_FRONT_DEG])
    sheet = Image.new("RGB", (len(columns) * size, len(rows) * (size + _TITLE)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for y, (name, row) in enumerate(zip(rows, poses, strict=True)):
        for x, (title, pose) in enumerate(zip(columns, row, strict=True)):
            place = x * size, y * (size + _TITLE)
            sheet.paste(
                Image.fromarray(studio.photograph(pose, (_FRONT_DEG,))[0], "RGB"), (place[0], place[1] + _TITLE)
            )
            draw.text((place[0] + 6, place[1] + 5), f"{name}, {title}", fill=(30, 30, 30), font=font)
    out = io.BytesIO()
    sheet.save(out, "PNG", optimize=True)
    return out.getvalue()
