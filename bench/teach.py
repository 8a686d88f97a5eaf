"""Teach the shipped prior a noun from one mesh, and say what it learned and what it forgot.

    python bench/teach.py "a cow" spot.obj --steps 300

Prints the held-out losses, which nouns held-out pictures are taken for, and the share of CPU time of each part. With
`-o cow.safetensors`, the weights are kept for `meshdeform run sphere.glb "a cow" --model cow.safetensors`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from pathlib import Path

from meshdeform.priors.builtin.teaching.teacher import TeachConfig
from meshdeform.runs.devices import use_threads
from meshdeform.runs.lesson_files import MeshFile
from meshdeform.runs.teaching import TeachRequest, start
from meshdeform.support.files import write_files


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description="Teach the shipped prior a noun, and measure.")
    parser.add_argument("noun")
    parser.add_argument("meshes", type=Path, nargs="+")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--front", type=float, default=0.0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    use_threads(options.threads)
    config = TeachConfig(steps=options.steps, seed=options.seed)
    request = TeachRequest(options.noun, front_deg=options.front, config=config)
    marks = [time.process_time()]
    run = start(request, [MeshFile(path.name, path.read_bytes()) for path in options.meshes])
    marks.append(time.process_time())
    for _ in run:
        pass
    marks.append(time.process_time())
    made = run.finish()
    marks.append(time.process_time())
    report = json.loads(made["report"])
    for entry in report["held_out_loss"]:
        print(f"step {entry['step']:5}  held-out loss: new {entry['new']:.4f}, old {entry['old']:.4f}")
    for name, found in report["retrieval"].items():
        print(f"{name:12} {found}")
    spent = [after - before for before, after in itertools.pairwise(marks)]
    parts = dict(zip(("drawing", "training", "measuring"), spent, strict=True))
    print("CPU time:", ", ".join(f"{name} {part / sum(parts.values()):.0%}" for name, part in parts.items()))
    if options.output:
        write_files({options.output: made["result"], options.output.with_suffix(".preview.png"): made["preview"]})


if __name__ == "__main__":
    main()
