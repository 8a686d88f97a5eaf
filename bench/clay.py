"""Fit a sphere to the nouns, which moulds it, and draw the results on sheets.

    python -m bench.clay FOLDER [NOUN ...]                       sheets of 20 without titles, and the nouns of each
    python -m bench.clay --titled docs/pictures/nouns.png        one sheet of all, of a sphere of 5,120 faces

Prints for each noun the CPU seconds and the faces that turned over and that newly cut others.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw

from bench.label_sheets import picture, sheet
from meshdeform.exemplar.engine import ExemplarFit
from meshdeform.exemplar.shapes import Wish
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.vocabulary.nouns import NOUNS

_PER_SHEET = 20
_TILE, _LINE, _COLUMNS = 108, 16, 12


def moulded(nouns: Sequence[str], level: int) -> list[Image.Image]:
    """Fit a sphere of 20 * 4^level faces to each noun, print what it cost, and return pictures from two sides."""
    ball = icosphere(level)
    verts, faces = ball.verts, ball.faces
    pictures: list[Image.Image] = []
    for noun in nouns:
        start = time.process_time()
        run = ExemplarFit(verts, faces, None, Wish(noun))
        out = [stage.verts for stage in run][-1]
        assert out is not None
        seconds = time.process_time() - start
        quality = measure(verts, faces, out)
        cut = quality.self_intersections_added
        print(f"{noun:12} {seconds:5.2f} s  flipped {quality.flipped_faces:4}  cut {cut}", flush=True)
        pictures.append(picture(out, faces, ["body"] * len(faces), room=1.05))
    return pictures


def sheets(folder: Path, nouns: Sequence[str]) -> None:
    """Draw sheets without titles, for grades by eye."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = moulded(nouns, 5)
    for first in range(0, len(pictures), _PER_SHEET):
        name = folder / f"clay-{first // _PER_SHEET:02}"
        sheet(pictures[first : first + _PER_SHEET]).save(name.with_suffix(".png"))
        name.with_suffix(".txt").write_text("\n".join(nouns[first : first + _PER_SHEET]) + "\n")


def titled(path: Path, nouns: Sequence[str]) -> None:
    """Draw one sheet, small, a title above each."""
    tiles = []
    for noun, views in zip(nouns, moulded(nouns, 4), strict=True):
        tile = Image.new("RGB", (_TILE, _TILE + _LINE), "white")
        ImageDraw.Draw(views).rectangle((0, views.height - 12, 40, views.height), "white")  # the name of its one part
        one = views.crop((0, 0, views.height, views.height))
        tile.paste(one.resize((_TILE, _TILE), Image.Resampling.LANCZOS), (0, _LINE))
        ImageDraw.Draw(tile).text((3, 2), noun, "black")
        tiles.append(tile)
    sheet(tiles, _COLUMNS).quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    if sys.argv[1] == "--titled":
        titled(Path(sys.argv[2]), sorted(NOUNS))
    else:
        sheets(Path(sys.argv[1]), sys.argv[2:] or list(NOUNS))
