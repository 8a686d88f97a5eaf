"""Draw a sheet of many prompts, each deforming the sphere as `meshdeform run` does.

    python -m bench.gallery docs/pictures/gallery.png            24 prompts, two views of each
    python -m bench.gallery docs/pictures/nouns.png --nouns      every noun of the vocabulary, one view of each

Prints the mesh quality of each prompt, and the totals.
"""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw

from bench.jobs import EXAMPLES, deformed
from meshdeform.priors.builtin.grammar import ParsedPrompt
from meshdeform.priors.builtin.vocabulary import NOUNS

PROMPTS = [
    *["a mushroom", "a vase", "a tall thin vase", "a bottle", "a goblet", "a table", "a chair", "a lamp"],
    *["a giraffe", "a dog", "a horse", "an elephant", "a rabbit", "a penguin", "a duck", "a dinosaur"],
    *["a fish", "a whale", "a turtle", "an airplane", "a rocket", "a car", "a house", "a tree"],
]
VIEW = 256
"""Pixels of a view in the picture of a job, which has the source's two above the result's."""
LINE = 18


def draw(path: Path, prompts: Sequence[str], views: int, columns: int, tile: int) -> None:
    """Draw the sheet: the last `views` views of each result, `tile` pixels wide."""
    sheet = Image.new("RGB", (columns * views * tile, -(-len(prompts) // columns) * (tile + LINE)), "white")
    pen = ImageDraw.Draw(sheet)
    flipped = crossing = 0
    for number, prompt in enumerate(prompts):
        made = deformed((EXAMPLES / "sphere.glb").read_bytes(), "sphere.glb", prompt)
        quality = json.loads(made["report.json"])["quality"]
        flips, cuts = quality["flipped_faces"], quality["self_intersecting_faces_after"]
        flipped, crossing = flipped + flips, crossing + cuts
        distortion = quality["symmetric_dirichlet_mean"]
        print(f"{prompt:<24} flipped {flips}  self-intersecting {cuts}  distortion {distortion:.2f}", flush=True)
        picture = Image.open(io.BytesIO(made["preview.png"]))
        shown = picture.crop((VIEW * (2 - views), VIEW, 2 * VIEW, 2 * VIEW))
        x, y = number % columns * views * tile, number // columns * (tile + LINE)
        sheet.paste(shown.resize((views * tile, tile), Image.Resampling.LANCZOS), (x, y))
        if views == 2:
            pen.rectangle((x, y, x + 60, y + 14), fill=(242, 242, 242))  # the word "result" of the left view
        pen.text((x + 6, y + tile + 2), prompt, fill="black")
    sheet.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{len(prompts)} prompts: {flipped} flipped faces, {crossing} self-intersecting faces in all")


if __name__ == "__main__":
    if "--nouns" in sys.argv:
        draw(Path(sys.argv[1]), [str(ParsedPrompt(noun)) for noun in sorted(NOUNS)], views=1, columns=12, tile=108)
    else:
        draw(Path(sys.argv[1]), PROMPTS, views=2, columns=4, tile=192)
