"""Draw the contact sheet of a batch: each row before and after, with its name; failed rows are crossed out."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

__all__ = ["contact_sheet"]

_WIDTH, _HEIGHT, _CAPTION, _GAP = 288, 144, 30, 8
_MAX_TILES = 600
_RED, _GREY, _INK = (198, 40, 40), (205, 205, 205), (30, 30, 30)


def contact_sheet(records: Sequence[Mapping[str, Any]], pictures: Sequence[Path]) -> bytes | None:
    """Return a PNG with the first 600 rows; None if no row succeeded.

    Parameters
    ----------
    records : sequence of mapping
        `name`, `state`, `prompt` and `error_code` of each row, in order.
    pictures : sequence of Path
        The `preview.png` of each row, which need not exist.
    """
    if not any(record["state"] == "succeeded" for record in records):
        return None
    shown = records[:_MAX_TILES]
    columns = max(1, round(math.sqrt(len(shown) / 1.5)))
    lines = math.ceil(len(shown) / columns)
    size = (_GAP + columns * (_WIDTH + _GAP), _GAP + lines * (_HEIGHT + _CAPTION + _GAP))
    sheet = Image.new("RGB", size, "white")
    for index, (record, path) in enumerate(zip(shown, pictures, strict=False)):
        row, column = divmod(index, columns)
        _tile(sheet, (_GAP + column * (_WIDTH + _GAP), _GAP + row * (_HEIGHT + _CAPTION + _GAP)), path, record)
    out = io.BytesIO()
    sheet.save(out, "PNG", optimize=True)
    return out.getvalue()


def _tile(sheet: Image.Image, at: tuple[int, int], path: Path, record: Mapping[str, Any]) -> None:
    draw, (x, y) = ImageDraw.Draw(sheet), at
    picture = _picture(path) if record["state"] == "succeeded" else None
    if picture is not None:
        sheet.paste(picture, (x + (_WIDTH - picture.width) // 2, y + (_HEIGHT - picture.height) // 2))
    colour = _GREY if record["state"] in ("succeeded", "pending") else _RED
    draw.rectangle((x - 1, y - 1, x + _WIDTH, y + _HEIGHT), outline=colour)
    if colour is _RED:
        draw.line((x, y, x + _WIDTH, y + _HEIGHT), fill=_RED)
        draw.line((x, y + _HEIGHT, x + _WIDTH, y), fill=_RED)
    second = record["prompt"] if record["state"] == "succeeded" else record["error_code"] or record["state"]
    _write(draw, (x, y + _HEIGHT + 2), str(record["name"]), _INK)
    _write(draw, (x, y + _HEIGHT + 15), str(second), _INK if picture is not None else colour)


def _picture(path: Path) -> Image.Image | None:
    try:
        with Image.open(path) as found:
            return _pair(found.convert("RGB"))
    except (OSError, ValueError, Image.DecompressionBombError):
        return None


def _pair(preview: Image.Image) -> Image.Image:
    """Return the first view of a preview's two rows side by side: before and after."""
    side = preview.height // 2
    pair = Image.new("RGB", (_WIDTH, _HEIGHT), "white")
    for k in range(2):
        view = preview.crop((0, k * side, side, (k + 1) * side))
        pair.paste(view.resize((_HEIGHT, _HEIGHT), Image.Resampling.LANCZOS), (k * _WIDTH // 2, 0))
    return pair


def _write(draw: ImageDraw.ImageDraw, at: tuple[int, int], text: str, colour: Any) -> None:
    """Write one line, truncated at the edge of the tile."""
    font = ImageFont.load_default(11)
    while text and draw.textlength(text, font=font) > _WIDTH:
        text = text[:-2].rstrip(".") + "." if len(text) > 2 else ""
    draw.text(at, text, fill=colour, font=font)
