"""Measure how often `family_fit` notices that some of a collection are of another family.

    python bench/family_strangers.py --members 20 --others 4

For each ordered pair of the parametric families, members of the first, ten of them labelled, and a few of the second in
one collection; and each family alone, where nothing should be named. Each run is the whole job with the default
parameters, on one thread.

    python bench/family_strangers.py --nouns

measures the same on families that the rule was not made for: the builtin prior's nouns, twelve members each, of which
the first five, eight or ten are labelled, alone and with up to four members of another noun. Every fourth noun is left
out: on those and on the three families its thresholds were chosen. It needs no fit, only the samples.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a script finds its own folder only

from bench.parametric_families import PARTS, Member, family, labels_document, packed
from meshdeform.kinds.families.collection import SampledShape, sample_shape
from meshdeform.kinds.families.matching import unlike, unrelated
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import InputFile, RunInput
from training.prior.families import FAMILIES, member

_LABELLED = 10
_MEMBERS, _SAMPLES, _SEEN = 12, 300, 4


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


def scaled(shapes: list[SampledShape]) -> torch.Tensor:
    """Return the features (T, P, F) of shapes, of unit variance."""
    features = torch.stack([shape.features for shape in shapes])
    return (features - features.mean((0, 1))) / features.std((0, 1)).clamp_min(1e-6)


def unlike_in(shapes: list[SampledShape], labelled: int) -> list[int]:
    """Return the numbers of the shapes that are unlike the first ones, which are labelled."""
    return unlike(scaled(shapes), torch.arange(len(shapes)) < labelled) or []


def among_nouns(mixes: int) -> None:
    """Print how often members of other nouns, and members of the noun itself, are named."""
    shapes: dict[str, list[SampledShape]] = {}
    for place, noun in enumerate(FAMILIES):
        if place % _SEEN == 0:
            continue
        parts = [member(noun, (), np.random.default_rng([7, number])) for number in range(_MEMBERS)]
        shapes[noun] = [sample_shape(part.verts, part.faces, _SAMPLES, number) for number, part in enumerate(parts)]
    nouns = list(shapes)
    random = np.random.default_rng(1)
    single = [unrelated(scaled(shapes[noun])) for noun in nouns]
    picks = [random.choice(len(nouns), _MEMBERS, replace=False) for _ in nouns]
    mixed = [unrelated(scaled([shapes[nouns[each]][0] for each in pick])) for pick in picks]
    for title, found in (("collections of one noun", single), ("mixes of twelve nouns", mixed)):
        spreads = [spread for spread, _ in found]
        flagged = sum(bool(farthest) for _, farthest in found)
        print(f"{flagged} of {len(found)} {title} are no family; {min(spreads):.2f} to {max(spreads):.2f} apart")
    for labelled in (5, 8, 10):
        random = np.random.default_rng(0)
        alone = sum(len(unlike_in(shapes[noun], labelled)) for noun in nouns)
        right = others = wrong = 0
        for _ in range(mixes):
            one, other = random.choice(len(nouns), 2, replace=False)
            foreign = shapes[nouns[other]][: int(random.integers(1, 5))]
            found = unlike_in([*shapes[nouns[one]], *foreign], labelled)
            right += sum(number >= _MEMBERS for number in found)
            wrong += sum(number < _MEMBERS for number in found)
            others += len(foreign)
        print(
            f"{len(nouns)} nouns, {labelled} labelled: {alone} members named where a noun is alone; in {mixes} mixes "
            f"{right} of {others} strangers and {wrong} members",
            flush=True,
        )


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--members", type=int, default=20)
    parser.add_argument("--others", type=int, default=4)
    parser.add_argument("--families", choices=sorted(PARTS), nargs="+", default=sorted(PARTS))
    parser.add_argument("--nouns", action="store_true", help="measure the rule on the builtin prior's nouns instead")
    parser.add_argument("--mixes", type=int, default=1000)
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.nouns:
        among_nouns(options.mixes)
        return
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
