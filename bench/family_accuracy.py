"""Measure parts, correspondences and sub-classes of the parametric families, by the files that a fit writes.

    python -m bench.family_accuracy 50

Each family is fitted by the whole job, ten members labelled and the others held out, on one thread.

Parts: the share of the held-out members' surface whose part is right. Correspondences: a template point that exists on
two members ties a place on one to a place on the other; it is right within 5 % of the diagonal of where the place
truly is, over random pairs of held-out members. `found` is the share of the places which the other member truly has
whose point exists there, and `invented` the share of ties to a member that lacks the solid, which are not counted as
wrong. Sub-classes: the nearest of ten random members of each sub-class, by L1 distance of the descriptors, for all
others, averaged over 200 draws.
"""

from __future__ import annotations

import argparse
import io
import json
import time
import zipfile
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from bench.jobs import artifacts, start
from bench.parametric_families import CLASSES, PARTS, Member, family, labels_document, packed
from meshdeform.assets import load_asset

_LABELLED, _EXAMPLES, _DRAWS, _PAIRS, _WITHIN = 10, 10, 200, 60, 0.05

Arrays = dict[str, NDArray[Any]]


def collection_of(name: str, members: list[Member]) -> bytes:
    """Return the ZIP of members of a parametric family, ten of them labelled."""
    buffer = io.BytesIO(packed(members))
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(zipfile.ZipInfo("labels.json"), json.dumps(labels_document(name, members, _LABELLED)))
    return buffer.getvalue()


def fitted(data: bytes) -> tuple[float, dict[str, bytes]]:
    """Return the CPU seconds of a fit, and the artifacts."""
    begun = time.process_time()
    made = artifacts(start({"kind": "family_fit", "params": {"read": False}}, {"collection": (data, "members.zip")}))
    return time.process_time() - begun, made


def confusion(name: str, members: list[Member], segments: Arrays) -> NDArray[np.float64]:
    """Return the share of each true part's area (rows) that has each part (columns), over the held-out members."""
    found = np.zeros((len(PARTS[name]), len(PARTS[name])))
    for t, member in enumerate(members[_LABELLED:], _LABELLED):
        surface = load_asset(member.glb(), member.name).surface
        corners = surface.positions[surface.triangles]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        truth = np.array([PARTS[name].index(part) for part in member.parts()])
        np.add.at(found, (truth, segments[f"{t:04d}"]), areas / areas.sum())
    return found


@dataclass(frozen=True)
class Ties:
    """Ties between pairs: which are right (N,), their parts (N,), and the shares that are found and invented."""

    right: NDArray[np.bool_]
    part: NDArray[np.int64]
    found: float
    invented: float


def ties(members: list[Member], places: Arrays) -> Ties:
    """Measure the correspondences of `_PAIRS` pairs of held-out members."""
    random = np.random.default_rng(0)
    diagonals = [float(np.linalg.norm(np.ptp(load_asset(m.glb(), m.name).surface.positions, 0))) for m in members]
    right, parts, found, invented = [], [], [], []
    for _ in range(_PAIRS):
        a, b = random.choice(np.arange(_LABELLED, len(members)), 2, replace=False)
        here = np.flatnonzero(places["exists"][a])
        truth = members[a].counterparts(members[b], places["triangles"][a, here], places["weights"][a, here])
        error = np.linalg.norm(places["positions"][b, here] - truth, axis=1) / diagonals[b]
        known, tied = np.isfinite(error), places["exists"][b, here]
        right.append(error[known & tied] < _WITHIN)
        parts.append(places["part"][here[known & tied]])
        found.append(tied[known])
        invented.append(~known[tied])
    shares = float(np.concatenate(found).mean()), float(np.concatenate(invented).mean())
    return Ties(np.concatenate(right), np.concatenate(parts), *shares)


def classified(members: list[Member], descriptors: NDArray[np.float32]) -> float:
    """Return how often the nearest of ten examples of each sub-class has the right one."""
    random = np.random.default_rng(0)
    kinds = np.array([member.kind for member in members])
    every = torch.from_numpy(descriptors)
    distance = torch.cdist(every, every, p=1).numpy()
    right = []
    for _ in range(_DRAWS):
        draws = [random.choice(np.flatnonzero(kinds == kind), _EXAMPLES, replace=False) for kind in np.unique(kinds)]
        examples = np.concatenate(draws)
        others = np.setdiff1d(np.arange(len(kinds)), examples)
        nearest = examples[distance[np.ix_(others, examples)].argmin(1)]
        right.append((kinds[nearest] == kinds[others]).mean())
    return float(np.mean(right))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, help="members of each family")
    options = parser.parse_args()
    if options.count < (least := (_EXAMPLES + 1) * max(len(CLASSES[name]) for name in PARTS)):
        parser.error(f"ten examples of each sub-class and one more are {least} members")
    torch.set_num_threads(1)
    for name in PARTS:
        members = family(name, options.count)
        seconds, made = fitted(collection_of(name, members))
        segments, places, looks = (
            dict(np.load(io.BytesIO(made[f"{file}.npz"])))
            for file in ("segmentation", "correspondences", "descriptors")
        )
        report = json.loads(made["report.json"])
        table = confusion(name, members, segments)
        tied = ties(members, places)
        print(f"{name}: {options.count} members, {seconds / 60:.1f} CPU minutes")
        print(f"  parts            {report['accuracy']['parts']:.1%}, mean over held-out members")
        for part, row in zip(PARTS[name], table, strict=True):
            taken = ", ".join(
                f"{other} {share / row.sum():.1%}" for other, share in zip(PARTS[name], row, strict=True) if share
            )
            print(f"    {part:12} is {taken}")
        print(f"  correspondences  {tied.right.mean():.1%} of {len(tied.right)}")
        print(f"    found {tied.found:.1%}, invented {tied.invented:.1%}")
        for number, part in enumerate(PARTS[name]):
            print(f"    {part:12} {tied.right[tied.part == number].mean():.1%}")
        print(f"  sub-classes      {classified(members, looks['descriptors']):.1%}", flush=True)


if __name__ == "__main__":
    main()
