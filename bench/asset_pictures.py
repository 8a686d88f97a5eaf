"""Draw real assets before and after: ``python bench/asset_pictures.py ASSETS [-o docs/pictures] [--animate]``.

Makes the pictures of docs/results.md from a folder with Duck.glb, spot.obj, chr_knight.glb and CesiumMilkTruck.glb:
runs each of them as `meshdeform run` does and keeps the preview. Prints the likeness and the quality of each. With
--animate, also writes each morph as WebP.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch

from meshdeform.assets import load_asset
from meshdeform.priors import load_prior
from meshdeform.rendering.studio import Pose, morph_animation
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input

ROOT = Path(__file__).resolve().parents[1]
PICTURES = {
    "duck_rabbit": ("Duck.glb", "a rabbit"),
    "spot_giraffe": ("spot.obj", "a giraffe"),
    "knight_snowman": ("chr_knight.glb", "a snowman"),
    "truck_boat": ("CesiumMilkTruck.glb", "a boat"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("assets", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "pictures")
    parser.add_argument("--only", choices=PICTURES, action="append")
    parser.add_argument("--preset", default="balanced")
    parser.add_argument("--steps", type=int)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--animate", action="store_true")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    prior = load_prior("builtin", device="cpu")
    params = grouped({"preset": arguments.preset, **({"steps": arguments.steps} if arguments.steps else {})})
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name in arguments.only or PICTURES:
        filename, prompt = PICTURES[name]
        data = (arguments.assets / filename).read_bytes()
        request = JobRequest.model_validate({"prompt": prompt, "params": params})
        run = text_deform.start(job_input(asset=data, filename=filename, request=request, prior=prior))
        for _ in run:
            pass
        artifacts = run.finish()
        (arguments.output / f"{name}.png").write_bytes(artifacts["preview.png"].data)
        if arguments.animate:
            source, result = load_asset(data, filename), load_asset(artifacts["result.glb"].data)
            poses = [Pose(asset.surface.positions, asset.surface.normals) for asset in (source, result)]
            morph = morph_animation(source.appearance(), *poses, kind="WEBP")
            (arguments.output / f"{name}.webp").write_bytes(morph)
        report = json.loads(artifacts["report.json"].data)
        found = report["likeness"]
        print(
            f"{name}: {found['noun']} {found['probability']:.0%}, rank {found['rank']}; {report['quality']}", flush=True
        )


if __name__ == "__main__":
    main()
