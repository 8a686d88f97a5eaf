"""Measure the CPU time of `family_fit` over the number of chairs, stage by stage, and fit its exponent.

    python bench/family_growth.py 50 100 200 300

Each run is the whole job with the default parameters (500 points, 1,000 samples), ten chairs labelled and the others
held out, on one thread. CPU minutes are what two cores share at best.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import time
import zipfile
from itertools import pairwise
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a script finds its own folder only

from bench.growth_chart import Series, exponent
from bench.parametric_families import PARTS, family, labels_document, packed
from meshdeform.cli.kinds import packed as folder_packed
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import ArtifactData, InputFile, RunInput
from meshdeform.runs.family_fit_kind import READ_STEPS

STAGES = ("reading", "inference", "learning", "results")


def collection_of(name: str, count: int, seed: int = 0) -> bytes:
    """Return the ZIP of `count` members of a parametric family, ten of them labelled, or of a folder of assets."""
    if name not in PARTS:
        return folder_packed(Path(name), 2**30, None)
    members = family(name, count, seed)
    buffer = io.BytesIO(packed(members))
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(zipfile.ZipInfo("labels.json"), json.dumps(labels_document(name, members, 10)))
    return buffer.getvalue()


def fitted(data: bytes, params: dict[str, int]) -> tuple[list[float], dict[str, ArtifactData]]:
    """Return the CPU seconds of each of `STAGES`, and the artifacts."""
    request = JobRequest.model_validate({"kind": "family_fit", "params": params})
    times = [time.process_time()]
    run = start_run(RunInput(request, {"collection": InputFile(data, "members.zip")}))
    ends = (READ_STEPS, READ_STEPS + params.get("iterations", 20))
    for report in run:
        if report.step in ends:
            times.append(time.process_time())
    times.append(time.process_time())
    artifacts = run.finish()
    times.append(time.process_time())
    return [b - a for a, b in pairwise(times)], artifacts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("counts", type=int, nargs="+")
    parser.add_argument("--family", choices=sorted(PARTS), default="chairs")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=NUMBER", help="a parameter of the job")
    options = parser.parse_args()
    params = {name: int(value) for name, value in (each.split("=") for each in options.set)}
    torch.set_num_threads(1)
    found = []
    for count in options.counts:
        seconds, artifacts = fitted(collection_of(options.family, count), params)
        report = json.loads(artifacts["report.json"].data)
        found.append(seconds)
        stages = "  ".join(f"{stage} {each:.0f}" for stage, each in zip(STAGES, seconds, strict=True))
        right, nearest = report["accuracy"]["parts"], report["classes"]["nearest_neighbour"]
        print(f"{count:5}  {sum(seconds) / 60:.1f} CPU minutes; seconds: {stages}", flush=True)
        print(f"       parts {right:.1%} by area; sub-class by nearest neighbour {nearest:.1%}", flush=True)
    if len(found) > 1:
        columns = [*zip(*found, strict=True), [sum(each) for each in found]]
        for stage, column in zip((*STAGES, "whole job"), columns, strict=True):
            power = exponent(Series(stage, "shapes", [float(n) for n in options.counts], list(column)))
            print(f"{stage:10} grows as the power {power:.2f}")


if __name__ == "__main__":
    main()
