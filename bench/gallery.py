"""Draw a sheet of many prompts: ``python bench/gallery.py -o gallery.png [--preset NAME] [--seed N] ["a vase" ...]``.

Deforms one asset by each prompt, as `meshdeform run` does, and puts two views of each result into a contact sheet.
Prints the mesh quality of each prompt, and the totals.
"""

from __future__ import annotations

import argparse
import io
import json
from pathlib import Path

import torch
from PIL import Image, ImageDraw

from meshdeform.priors import load_prior
from meshdeform.requests.document import JobRequest
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input

ROOT = Path(__file__).resolve().parents[1]
PROMPTS = [
    *["a mushroom", "a vase", "a tall thin vase", "a bottle", "a goblet", "a table", "a chair", "a lamp"],
    *["a giraffe", "a dog", "a horse", "an elephant", "a rabbit", "a penguin", "a duck", "a dinosaur"],
    *["a fish", "a whale", "a turtle", "an airplane", "a rocket", "a car", "a house", "a tree"],
]
COLUMNS = 4
TILE = 192


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("prompts", nargs="*", default=PROMPTS)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--asset", type=Path, default=ROOT / "examples" / "sphere.glb")
    parser.add_argument("--preset", default="balanced")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    prior = load_prior("builtin", device="cpu")
    rows = -(-len(arguments.prompts) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * 2 * TILE, rows * (TILE + 18)), "white")
    draw = ImageDraw.Draw(sheet)
    flipped = crossing = 0
    for number, prompt in enumerate(arguments.prompts):
        params = {"preset": arguments.preset, "seed": arguments.seed}
        request = JobRequest.model_validate({"prompt": prompt, "params": params})
        run = text_deform.start(
            job_input(asset=arguments.asset.read_bytes(), filename=arguments.asset.name, request=request, prior=prior)
        )
        for _ in run:
            pass
        artifacts = run.finish()
        quality = json.loads(artifacts["report.json"].data)["quality"]
        flipped += quality["flipped_faces"]
        crossing += quality["self_intersecting_faces_after"]
        print(
            f"{prompt:<24} flipped {quality['flipped_faces']:>4}  "
            f"self-intersecting {quality['self_intersecting_faces_after']:>5}  "
            f"symmetric Dirichlet {quality['symmetric_dirichlet_mean']:>6.2f}",
            flush=True,
        )
        picture = Image.open(io.BytesIO(artifacts["preview.png"].data))
        half = picture.crop((0, 256, 512, 512)).resize((2 * TILE, TILE), Image.Resampling.LANCZOS)
        x, y = number % COLUMNS * 2 * TILE, number // COLUMNS * (TILE + 18)
        sheet.paste(half, (x, y))
        draw.rectangle((x, y, x + 60, y + 14), fill=(242, 242, 242))
        draw.text((x + 6, y + TILE + 2), prompt, fill="black")
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(arguments.output, optimize=True)
    print(f"{len(arguments.prompts)} prompts: {flipped} flipped faces, {crossing} self-intersecting faces in all")


if __name__ == "__main__":
    main()
