"""Measure how often `family_fit` notices that some of a collection are of another family.

    python bench/family_strangers.py --members 20 --others 4

For each ordered pair of the parametric families, members of the first, ten of them labelled, and a few of the second in
one collection; and each family alone, where nothing should be named. Each run is the whole job with the default
parameters, on one thread.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import zipfile
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a script finds its own folder only

from bench.parametric_families import PARTS, Member, family, labels_document, packed
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import InputFile, RunInput

_LABELLED = 10


def named(members: list[Member], labels: dict[str, object]) -> set[str]:
    """Return the names of the members that the report of a fit lists as strangers."""
    buffer = io.BytesIO(packed(members))
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(zipfile.ZipInfo("labels.json"), json.dumps(labels))
    request = JobRequest.model_validate({"kind": "family_fit"})
    run = start_run(RunInput(request, {"collection": InputFile(buffer.getvalue(), "members.zip")}))
    for _ in run:
        pass
    report = json.loads(run.finish()["report.json"].data)
    return set(report["strangers"])


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--members", type=int, default=20)
    parser.add_argument("--others", type=int, default=4)
    parser.add_argument("--families", choices=sorted(PARTS), nargs="+", default=sorted(PARTS))
    options = parser.parse_args()
    torch.set_num_threads(1)
    found = wrong = 0
    for name in options.families:
        own = family(name, options.members)
        labels = labels_document(name, own, _LABELLED)
        alone = named(own, labels)
        wrong += len(alone)
        print(f"{name} alone: {len(alone)} of {len(own)} named", flush=True)
        for other in sorted(set(PARTS) - {name}):
            foreign = family(other, options.others)
            seen = named([*own, *foreign], labels)
            right = seen & {member.name for member in foreign}
            found, wrong = found + len(right), wrong + len(seen - right)
            print(f"{name} with {other}: {len(right)} of {len(foreign)} named, {len(seen - right)} others", flush=True)
    print(f"in all {found} strangers found, and {wrong} members named by mistake")


if __name__ == "__main__":
    main()
