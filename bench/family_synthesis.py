"""Measure new shapes of a parametric family against members that were held out.

    python bench/family_synthesis.py chairs 40

The correspondences are those of one fit of all members. The machine and a linear model (principal components of places
and existence, with normal coefficients) are learned from the members that are not held out, and all models take parts
from these only. A random recombination takes each part, unchanged, of another member. `training` are members
themselves.

Shapes are compared by the Chamfer distance of samples of their surfaces, with the diagonal as unit: the mean distance
of held-out members to the nearest shape (minimum matching distance, less is better), the share of held-out members that
are the nearest one of a shape (coverage, more is better), and how often the nearest neighbour of a shape or a held-out
member is of the same group (1-NN accuracy, 50 % is best). Sources: Achlioptas et al. 2018, Yang et al. 2019.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a script finds its own folder only

from bench.parametric_families import PARTS, Member, family, labels_document, packed
from meshdeform.assets import Asset, load_asset
from meshdeform.assets.assemble import assemble
from meshdeform.assets.family_file import FamilyFile, read_family
from meshdeform.cli.family_folders import packed as with_labels
from meshdeform.families.assembly import Assembler
from meshdeform.families.boundary import boundary_defects
from meshdeform.families.collection import sample_shape
from meshdeform.families.learning import Learning
from meshdeform.families.machine import BetaMachine
from meshdeform.families.members import turned
from meshdeform.families.sampling import Drawn, sampled, to_frame, to_machine
from meshdeform.families.templates import graph
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import InputFile, RunInput

_SAMPLES = 256


def fitted(name: str, members: list[Member], folder: Path, params: dict[str, int]) -> FamilyFile:
    """Fit a family to all members, ten of them labelled."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "members.zip").write_bytes(packed(members))
    (folder / "labels.json").write_text(json.dumps(labels_document(name, members, 10)), encoding="utf-8")
    data = with_labels(folder / "members.zip", 2**30, folder / "labels.json")
    request = JobRequest.model_validate({"kind": "family_fit", "params": params})
    run = start_run(RunInput(request, {"collection": InputFile(data, "members.zip")}))
    for _ in run:
        pass
    artifacts = run.finish()
    print(f"part accuracy of the fit  {json.loads(artifacts['report.json'].data)['accuracy']['parts']:.1%}", flush=True)
    return read_family(artifacts["family.safetensors"].data)


def first_of(found: FamilyFile, count: int) -> FamilyFile:
    """Return the family with its first members only."""
    per_member = (
        "names",
        "digests",
        "points",
        "triangles",
        "exists",
        "centres",
        "diagonals",
        "turns",
        "descriptors",
        "segments",
    )
    return dataclasses.replace(found, **{name: getattr(found, name)[:count] for name in per_member})


def learned(found: FamilyFile, points: Tensor, exists: Tensor, epochs: int) -> BetaMachine:
    """Learn the machine from the members of a family."""
    random = torch.Generator().manual_seed(0)
    labels = torch.from_numpy(found.labels.copy())
    mean = (points * exists[:, :, None]).sum(0) / exists.sum(0).clamp_min(1)[:, None]
    machine = BetaMachine.start(points, exists, labels, random)
    learning = Learning.start(machine, points, exists, graph(mean, labels), random)
    for _ in range(epochs):
        learning.step(epochs)
    return learning.finished()


def linear(points: Tensor, exists: Tensor, random: np.random.Generator) -> Drawn:
    """Draw a shape from the principal components of places and existence that have 95 % of the variance."""
    mean = (points * exists[:, :, None]).sum(0) / exists.sum(0).clamp_min(1)[:, None]
    filled = torch.where(exists[:, :, None] > 0, points, mean).reshape(len(points), -1)
    rows = torch.cat([filled, 0.1 * exists], 1).numpy()  # so that both parts have about the same variance
    centre = rows.mean(0)
    _, values, axes = np.linalg.svd(rows - centre, full_matrices=False)
    kept = int((np.cumsum(values**2) < 0.95 * (values**2).sum()).sum()) + 1
    drawn = centre + (random.normal(size=kept) * values[:kept] / np.sqrt(len(rows))) @ axes[:kept]
    place = torch.from_numpy(drawn[: filled.shape[1]]).float().reshape(-1, 3)
    there = torch.from_numpy(drawn[filled.shape[1] :] > 0.05).float()
    return Drawn(place.clamp(1e-4, 1 - 1e-4), there)


def cloud(asset: Asset, seed: int, turn: float = 0.0) -> NDArray[np.float64]:
    """Return samples (P, 3) of a surface, with the diagonal as unit."""
    shape = sample_shape(asset.surface.positions, asset.surface.triangles, _SAMPLES, seed)
    return turned(shape.points, turn)


def scores(made: list[NDArray[np.float64]], held: list[NDArray[np.float64]]) -> tuple[float, float, float]:
    """Return minimum matching distance, coverage and 1-NN accuracy."""
    both = torch.from_numpy(np.stack([*made, *held])).float()
    distance = torch.zeros(len(both), len(both))
    for row, each in enumerate(both):
        found = torch.cdist(each.expand_as(both), both)
        distance[row] = (found.amin(1).mean(1) + found.amin(2).mean(1)) / 2
    across = distance[: len(made), len(made) :]
    group = torch.arange(len(both)) < len(made)
    nearest = distance.fill_diagonal_(torch.inf).argmin(1)
    coverage = len(set(across.argmin(1).tolist())) / len(held)
    return float(across.amin(0).mean()), coverage, float((group[nearest] == group).float().mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("family", choices=sorted(PARTS))
    parser.add_argument("count", type=int)
    parser.add_argument("--held", type=int, default=16, help="members held out, and shapes made")
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--iterations", type=int, default=20)
    parser.add_argument("--epochs", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--folder", type=Path, default=Path("family_synthesis"))
    options = parser.parse_args()
    members = family(options.family, options.count)
    names = ("points", "samples", "iterations", "epochs")
    whole = fitted(options.family, members, options.folder, {name: getattr(options, name) for name in names})
    train = first_of(whole, options.count - options.held)
    assets = [load_asset(member.glb(), member.name) for member in members]
    scaling = torch.from_numpy(train.scaling.copy())
    points = to_machine(torch.from_numpy(train.points.copy()).float(), scaling).clamp(1e-4, 1 - 1e-4)
    exists = torch.from_numpy(train.exists.copy()).float()
    machine = learned(train, points, exists, options.epochs)
    defects = np.stack(
        [
            boundary_defects(a.surface.positions, a.surface.triangles, segments, len(train.parts))
            for a, segments in zip(assets, train.segments, strict=False)
        ]
    )
    print(f"parts with a clean boundary  {(defects <= 0.25).sum() / np.isfinite(defects).sum():.1%}", flush=True)
    assembler = Assembler(train, lambda member: assets[member], defects, 0.25)
    size = {"diagonal": 1.0, "centre": np.zeros(3)}

    def built(drawn: Drawn) -> Asset:
        place, there = to_frame(drawn.points, scaling).double().numpy(), drawn.exists.numpy() > 0
        chosen = {part: assembler.choose(place, there, part) for part in assembler.parts_of(there)}
        choice = {part: found[0] for part, found in chosen.items() if found is not None}
        return load_asset(assemble(assembler.assemble(place, there, choice, **size).pieces))

    def recombined(random: np.random.Generator) -> Asset:
        pattern = assembler.shape(int(random.integers(len(train.names)))).present
        owners = {part: random.choice(np.flatnonzero(np.isfinite(defects[:, part]))) for part in pattern}
        choice = {part: int(owner) for part, owner in owners.items()}
        made = assembler.assemble(train.points[0], train.exists[0], choice, kept=list(choice), **size)
        return load_asset(assemble(made.pieces))

    held = [cloud(assets[t], t, float(whole.turns[t])) for t in range(len(train.names), options.count)]
    makers = {
        "machine": lambda random: built(sampled(machine, points, exists, options.rounds, random)),
        "linear": lambda random: built(linear(points, exists, random)),
        "recombination": recombined,
    }
    print(f"{'':14} {'distance':>9} {'coverage':>9} {'1-NN':>7}")
    for title, make in makers.items():
        random = np.random.default_rng(0)
        made = [make(random) for _ in range(options.held)]
        for number, asset in enumerate(made):
            (options.folder / f"{title}_{number:02d}.glb").write_bytes(asset.to_bytes())
        report(title, [cloud(asset, number) for number, asset in enumerate(made)], held)
    chosen = np.random.default_rng(0).choice(len(train.names), options.held, replace=False)
    report("training", [cloud(assets[t], t, float(whole.turns[t])) for t in chosen], held)


def report(title: str, made: list[NDArray[np.float64]], held: list[NDArray[np.float64]]) -> None:
    distance, coverage, accuracy = scores(made, held)
    print(f"{title:14} {distance:9.4f} {coverage:9.1%} {accuracy:7.1%}", flush=True)


if __name__ == "__main__":
    main()
