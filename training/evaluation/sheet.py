"""Draw the contact sheet: a row per prompt, a column per source, the first seed's result after the last step.

With one source, or where most sources have few of the prompts, the results follow each other in rows of twelve instead.

A green frame marks a hit, a red one a miss (with the prompt retrieved instead), a grey one a result that was not
judged; a crossed tile failed, an empty one is not done. Prompts without any finished item have no row.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw

from training.evaluation.evaluator import item_folder, source_path
from training.evaluation.mesh_file import read_ply
from training.evaluation.picture import SIZE, picture_png
from training.evaluation.suite import Item

_TILE = 144
_FRAME = 4
_LEFT = 180
_TOP = 20
_ACROSS = 12
_HIT, _MISS, _UNJUDGED = (46, 125, 50), (198, 40, 40), (150, 150, 150)


def contact_sheet(folder: Path, manifest: dict[str, Any], records: list[dict[str, Any]]) -> bytes:
    """Return the sheet as a PNG; its first row shows the sources."""
    sources, prompts, seed = list(manifest["sources"]), manifest["prompts"], manifest["seeds"][0]
    judged = {(record["source"], record["prompt"]): record for record in records if record["seed"] == seed}
    prompts = [prompt for prompt in prompts if any(done == prompt for _, done in judged)]
    if len(sources) == 1 or 2 * len(judged) < len(sources) * len(prompts):
        return _png(_in_rows(folder, sources, judged))
    sheet = Image.new("RGB", (_LEFT + _TILE * len(sources), _TOP + _TILE * (len(prompts) + 1)), "white")
    draw = ImageDraw.Draw(sheet)
    for column, source in enumerate(sources):
        x = _LEFT + column * _TILE
        draw.text((x + 6, 4), Path(source).stem, fill="black")
        path = source_path(folder, source)
        if path.exists():
            _tile(sheet, (x, _TOP), picture_png(read_ply(path.read_bytes())), "white")
        for row, prompt in enumerate(prompts, 1):
            if record := judged.get((source, prompt)):
                _result(sheet, (x, _TOP + row * _TILE), folder, record)
    for row, prompt in enumerate(["source", *prompts]):
        draw.text((6, _TOP + row * _TILE + _TILE // 2 - 6), prompt, fill="black")
    return _png(sheet)


def _in_rows(folder: Path, sources: list[str], rows: dict[tuple[str, str], dict[str, Any]]) -> Image.Image:
    """Return the sources and then the results, each below its name."""
    tiles: list[tuple[str, str | None]] = [(source, None) for source in sources]
    tiles += sorted(rows, key=lambda pair: (sources.index(pair[0]), pair[1]))
    across = min(_ACROSS, len(tiles))
    sheet = Image.new("RGB", (_TILE * across, (_TOP + _TILE) * -(-len(tiles) // across)), "white")
    for number, (source, prompt) in enumerate(tiles):
        x, y = number % across * _TILE, number // across * (_TOP + _TILE)
        name = " ".join(filter(None, (Path(source).stem if len(sources) > 1 or not prompt else "", prompt)))
        ImageDraw.Draw(sheet).text((x + 6, y + 4), name, fill="black")
        if prompt:
            _result(sheet, (x, y + _TOP), folder, rows[source, prompt])
        elif (path := source_path(folder, source)).exists():
            _tile(sheet, (x, y + _TOP), picture_png(read_ply(path.read_bytes())), "white")
    return sheet


def _png(sheet: Image.Image) -> bytes:
    out = io.BytesIO()
    sheet.save(out, "PNG", optimize=True)
    return out.getvalue()


def _result(sheet: Image.Image, at: tuple[int, int], folder: Path, record: dict[str, Any]) -> None:
    draw, (x, y) = ImageDraw.Draw(sheet), at
    if record["failed"]:
        draw.line((x, y, x + _TILE, y + _TILE), fill=_MISS, width=2)
        draw.line((x, y + _TILE, x + _TILE, y), fill=_MISS, width=2)
        return
    state = record["states"][-1]
    place = item_folder(folder, Item(record["source"], record["prompt"], record["seed"]))
    judged = state["judge"] or state["clip"]
    colour = _UNJUDGED if not judged else _HIT if judged["hit"] else _MISS
    _tile(sheet, at, (place / f"steps-{state['steps']:06d}.png").read_bytes(), colour)
    if judged and not judged["hit"]:
        draw.text((x + 8, y + _TILE - 18), judged["retrieved"], fill=_MISS)


def _tile(sheet: Image.Image, at: tuple[int, int], png: bytes, colour: Any) -> None:
    side = _TILE - 2 * _FRAME
    picture = Image.open(io.BytesIO(png))
    assert picture.size == (SIZE, SIZE)
    sheet.paste(Image.new("RGB", (_TILE - 2, _TILE - 2), colour), (at[0] + 1, at[1] + 1))
    sheet.paste(picture.resize((side, side), Image.Resampling.LANCZOS), (at[0] + _FRAME, at[1] + _FRAME))
