"""Measure parts and correspondences of a parametric family by inference alone, without the Beta shape machine.

    python bench/family_accuracy.py airplanes 40

Part accuracy is the share of samples of the unlabelled members. A correspondence is right if it ends within 5 % of the
diagonal from the true place; where a member lacks the solid, the truth has none and the sample does not count.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a script finds its own folder only

from bench.parametric_families import PARTS, Member, family
from meshdeform.assets import load_asset
from meshdeform.families.collection import Collection, SampledShape, rotated, sample_shape
from meshdeform.families.inference import Inference


def matched(
    inference: Inference, members: list[Member], shapes: list[SampledShape], first: int, *, pairs: int, within: float
) -> float:
    """Return the share of right correspondences over random pairs of members from `first` on."""
    random = np.random.default_rng(0)
    collection = inference.collection
    shares = []
    for _ in range(pairs):
        a, b = random.choice(np.arange(first, len(members)), 2, replace=False)
        truth = members[a].counterparts(members[b], shapes[a].triangles, shapes[a].weights)
        known = torch.from_numpy(~np.isnan(truth[:, 0]))
        scaled = torch.from_numpy((truth - shapes[b].centre) / shapes[b].diagonal).float()
        scaled = rotated(scaled[None], collection.turns[b : b + 1])[0]
        q = inference.correspondences(a)[0]
        goal = inference.boxed[a] + q @ (inference.deformed[b] - inference.deformed[a])
        parts_a, parts_b = inference.parts[a].argmax(1), inference.parts[b].argmax(1)
        distance = torch.cdist(goal, inference.boxed[b]) + 0.5 * (parts_a[:, None] != parts_b)
        error = (collection.points[b][distance.argmin(1)] - scaled).norm(dim=1)[known]
        shares.append(float((error < within).float().mean()))
    return float(np.mean(shares))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("family", choices=sorted(PARTS))
    parser.add_argument("count", type=int)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--points", type=int, default=300)
    parser.add_argument("--labelled", type=int, default=10)
    parser.add_argument("--iterations", type=int, default=20)
    options = parser.parse_args()
    names, first = PARTS[options.family], options.labelled
    if options.count < first + 2:
        parser.error(f"there must be at least two members that are not labelled: {first + 2} in all")
    members = family(options.family, options.count)
    shapes, truth = [], []
    for number, member in enumerate(members):
        surface = load_asset(member.glb(), member.name).surface
        shape = sample_shape(surface.positions, surface.triangles, options.samples, number)
        shapes.append(shape)
        truth.append(np.array([names.index(part) for part in member.parts()])[shape.triangles])
    parts = torch.from_numpy(np.stack(truth))

    def stacked(values: list[np.ndarray]) -> Tensor:
        return torch.from_numpy(np.stack(values)).float()

    collection = Collection.of(
        stacked([shape.points for shape in shapes]),
        stacked([shape.normals for shape in shapes]),
        torch.stack([shape.features for shape in shapes]),
        torch.stack([shape.neighbours for shape in shapes]),
    )
    given = torch.full_like(parts, -1)
    given[:first] = parts[:first]
    inference = Inference.start(collection, given, options.points, len(names))
    for _ in range(options.iterations):
        inference.step()
    right = inference.parts.argmax(2)[first:] == parts[first:]
    print(f"parts            {float(right.float().mean()):.1%}")
    for number, name in enumerate(names):
        print(f"  {name:14} {float(right[parts[first:] == number].float().mean()):.1%}")
    print(f"correspondences  {matched(inference, members, shapes, first, pairs=60, within=0.05):.1%}")


if __name__ == "__main__":
    main()
