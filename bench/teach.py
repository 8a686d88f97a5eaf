"""Teach the shipped prior a noun from one mesh, and say what it learned and what it forgot.

    python bench/teach.py "a cow" spot.obj --steps 300

Prints the held-out losses, which nouns held-out pictures are taken for, and the share of CPU time of each part. With
`-o cow.safetensors`, the weights are kept for `meshdeform run sphere.glb "a cow" --model cow.safetensors`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import tempfile
import time
from pathlib import Path

import torch

from meshdeform.assets import load_asset
from meshdeform.geometry.weld import weld
from meshdeform.priors.builtin.grammar import ParsedPrompt, tokenise
from meshdeform.priors.builtin.network import read_network
from meshdeform.priors.builtin.taught import words_of
from meshdeform.priors.builtin.teaching.deformed import PictureSet, pictures
from meshdeform.priors.builtin.teaching.pictures import joined, shape_of
from meshdeform.priors.builtin.teaching.teacher import TeachConfig, held_out_loss, retrieved
from meshdeform.runs.base import WEIGHTS_ARTIFACT
from meshdeform.runs.devices import use_threads
from meshdeform.runs.prior_teach import TeachRequest, start_lesson
from meshdeform.runs.prior_teach_kind import MeshFile, MeshLabel
from meshdeform.support.files import write_files


def tested(weights: bytes, noun: str, paths: list[Path]) -> str:
    """Return the held-out loss and the retrieval of other meshes, each seen once from four sides."""
    with tempfile.TemporaryDirectory() as folder:
        (path := Path(folder) / "taught.safetensors").write_bytes(weights)
        network, metadata = read_network(path)
        words = words_of(metadata, path)
    network.eval()
    drawn = []
    for number, each in enumerate(paths):
        surface = load_asset(each.read_bytes(), each.name).surface
        shape = shape_of(weld(surface.positions, surface.triangles).mesh, each.name)
        views, azimuths = pictures(shape.part, 1, torch.Generator().manual_seed(number))
        tokens = torch.tensor([tokenise(ParsedPrompt(noun), words)])
        drawn.append(PictureSet(views, tokens, azimuths, torch.tensor([False])))
    all_of_them = joined(drawn)
    found = retrieved(network, words, all_of_them, list(words.nouns))
    return f"loss {held_out_loss(network, all_of_them):.4f}, {found.count(noun)} of {len(found)} taken for {noun}"


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description="Teach the shipped prior a noun, and measure.")
    parser.add_argument("noun")
    parser.add_argument("meshes", type=Path, nargs="+")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--front", type=float, default=0.0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--test", type=Path, nargs="+", default=[])
    parser.add_argument("--only-test", action="store_true", help="measure by the meshes of --test alone")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    use_threads(options.threads)
    config = TeachConfig(steps=options.steps, seed=options.seed)
    request = TeachRequest(front_deg=options.front, config=config)
    label = MeshLabel(options.noun)
    marks = [time.process_time()]
    run = start_lesson(request, [MeshFile(path.name, path.read_bytes(), label) for path in options.meshes])
    marks.append(time.process_time())
    for _ in run:
        pass
    marks.append(time.process_time())
    made = {WEIGHTS_ARTIFACT: run.weights()} if options.only_test else {n: a.data for n, a in run.finish().items()}
    marks.append(time.process_time())
    if not options.only_test:
        report = json.loads(made["report.json"])
        for entry in report["held_out_loss"]:
            print(f"step {entry['step']:5}  held-out loss: new {entry['new']:.4f}, old {entry['old']:.4f}")
        for name, found in report["retrieval"].items():
            print(f"{name:12} {found}")
    if options.test:
        print("test        ", tested(made[WEIGHTS_ARTIFACT], run.nouns[0], options.test))
    spent = [after - before for before, after in itertools.pairwise(marks)]
    parts = dict(zip(("drawing", "training", "measuring"), spent, strict=True))
    print("CPU time:", ", ".join(f"{name} {part / sum(parts.values()):.0%}" for name, part in parts.items()))
    if options.output:
        previews = {options.output.with_suffix(".preview.png"): made[name] for name in ("preview.png",) if name in made}
        write_files({options.output: made[WEIGHTS_ARTIFACT], **previews})


if __name__ == "__main__":
    main()
