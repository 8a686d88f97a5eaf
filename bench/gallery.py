"""Draw a sheet of many prompts: ``python -m bench.gallery docs/pictures/gallery.png``.

Deforms the sphere by each prompt, as `meshdeform run` does, and puts two views of each result into a contact sheet.
Prints the mesh quality of each prompt, and the totals.
"""

from __future__ import annotations

import io
import json
import sys

from PIL import Image, ImageDraw

from bench.jobs import EXAMPLES, deformed

PROMPTS = [
    *["a mushroom", "a vase", "a tall thin vase", "a bottle", "a goblet", "a table", "a chair", "a lamp"],
    *["a giraffe", "a dog", "a horse", "an elephant", "a rabbit", "a penguin", "a duck", "a dinosaur"],
    *["a fish", "a whale", "a turtle", "an airplane", "a rocket", "a car", "a house", "a tree"],
]
COLUMNS, TILE = 4, 192


def main() -> None:
    """Draw the sheet."""
    sheet = Image.new("RGB", (COLUMNS * 2 * TILE, -(-len(PROMPTS) // COLUMNS) * (TILE + 18)), "white")
    draw = ImageDraw.Draw(sheet)
    flipped = crossing = 0
    for number, prompt in enumerate(PROMPTS):
        made = deformed((EXAMPLES / "sphere.glb").read_bytes(), "sphere.glb", prompt)
        quality = json.loads(made["report.json"])["quality"]
        flips, cuts = quality["flipped_faces"], quality["self_intersecting_faces_after"]
        flipped, crossing = flipped + flips, crossing + cuts
        distortion = quality["symmetric_dirichlet_mean"]
        print(f"{prompt:<24} flipped {flips}  self-intersecting {cuts}  distortion {distortion:.2f}", flush=True)
        picture = Image.open(io.BytesIO(made["preview.png"]))
        half = picture.crop((0, 256, 512, 512)).resize((2 * TILE, TILE), Image.Resampling.LANCZOS)
        x, y = number % COLUMNS * 2 * TILE, number // COLUMNS * (TILE + 18)
        sheet.paste(half, (x, y))
        draw.rectangle((x, y, x + 60, y + 14), fill=(242, 242, 242))
        draw.text((x + 6, y + TILE + 2), prompt, fill="black")
    sheet.quantize(256, dither=Image.Dither.NONE).save(sys.argv[1], optimize=True)
    print(f"{len(PROMPTS)} prompts: {flipped} flipped faces, {crossing} self-intersecting faces in all")


if __name__ == "__main__":
    main()
