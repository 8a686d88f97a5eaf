"""Measure new shapes of a parametric family against members that were held out.

    python bench/family_synthesis.py chairs 64

The correspondences are those of one fit of all members. The machine and a linear model (principal components of places
and existence, with normal coefficients) are learned from the members that are not held out, and all models take parts
from these only. A random recombination takes each part, unchanged, of another member. `training` are members
themselves.

Shapes are compared by the Chamfer distance of samples of their surfaces, with the diagonal as unit: the mean distance
of held-out members to the nearest shape (minimum matching distance, less is better), the share of held-out members that
are the nearest one of a shape (coverage, more is better), and how often the nearest neighbour of a shape or a held-out
member is of the same group (1-NN accuracy, 50 % is best). Sources: Achlioptas et al. 2018, Yang et al. 2019. `copies`
is the share of shapes that are nearer to a training member than 95 % of the held-out members are (5 % is best).
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from dataclasses import dataclass
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
from meshdeform.cli.kinds import packed as with_labels
from meshdeform.kinds.families.assembly import Assembler
from meshdeform.kinds.families.boundary import boundary_defects
from meshdeform.kinds.families.collection import sample_shape
from meshdeform.kinds.families.inference import graph
from meshdeform.kinds.families.learning import Learning
from meshdeform.kinds.families.machine import BetaMachine
from meshdeform.kinds.families.members import turned
from meshdeform.kinds.families.sampling import Drawn, Unexplained, sampled, to_frame, to_machine
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import InputFile, RunInput

_SAMPLES = 600

Cloud = NDArray[np.float64]


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


def cloud(asset: Asset, seed: int, turn: float = 0.0) -> Cloud:
    """Return samples (P, 3) of a surface, with the diagonal as unit."""
    shape = sample_shape(asset.surface.positions, asset.surface.triangles, _SAMPLES, seed)
    return turned(shape.points, turn)


def chamfer(one: list[Cloud], other: list[Cloud]) -> Tensor:
    """Return the Chamfer distances (A, B) between clouds."""
    a, b = (torch.from_numpy(np.stack(each)).float() for each in (one, other))
    found = torch.zeros(len(a), len(b))
    for row, each in enumerate(a):
        for start in range(0, len(b), 8):
            apart = torch.cdist(each[None], b[start : start + 8])
            found[row, start : start + 8] = (apart.amin(1).mean(1) + apart.amin(2).mean(1)) / 2
    return found


@dataclass(frozen=True)
class Yardstick:
    """Held-out and training members, by which shapes are measured."""

    held: list[Cloud]
    train: list[Cloud]
    within: Tensor
    copy: float

    @classmethod
    def of(cls, held: list[Cloud], train: list[Cloud]) -> Yardstick:
        nearest = chamfer(held, train).amin(1)
        return cls(held, train, chamfer(held, held), float(nearest.quantile(0.05)))

    def report(self, title: str, made: list[Cloud]) -> None:
        """Print one line; there are as many shapes as held-out members."""
        across, count = chamfer(made, self.held), len(made)
        both = torch.cat([torch.cat([chamfer(made, made), across], 1), torch.cat([across.T, self.within], 1)])
        group = torch.arange(2 * count) < count
        nearest = both.fill_diagonal_(torch.inf).argmin(1)
        figures = (
            float(across.amin(0).mean()),
            len(set(across.argmin(1).tolist())) / count,
            float((group[nearest] == group).float().mean()),
            float((chamfer(made, self.train).amin(1) < self.copy).float().mean()),
        )
        print(f"{title:14} {figures[0]:9.4f} {figures[1]:9.1%} {figures[2]:7.1%} {figures[3]:7.1%}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("family", choices=sorted(PARTS))
    parser.add_argument("count", type=int)
    parser.add_argument("--held", type=int, default=32, help="members held out, and shapes made")
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

    clouds = [cloud(asset, t, float(whole.turns[t])) for t, asset in enumerate(assets)]
    measure = Yardstick.of(clouds[len(train.names) :], clouds[: len(train.names)])
    rest = Unexplained.of(machine, points, exists, torch.from_numpy(train.labels.copy()))
    makers = {
        "machine": lambda random: built(sampled(machine, points, exists, rest, options.rounds, random)),
        "linear": lambda random: built(linear(points, exists, random)),
        "recombination": recombined,
    }
    print(f"{'':14} {'distance':>9} {'coverage':>9} {'1-NN':>7} {'copies':>7}")
    for title, make in makers.items():
        random = np.random.default_rng(0)
        made = [make(random) for _ in range(options.held)]
        for number, asset in enumerate(made):
            (options.folder / f"{title}_{number:02d}.glb").write_bytes(asset.to_bytes())
        measure.report(title, [cloud(asset, number) for number, asset in enumerate(made)])
    if len(train.names) >= options.held:
        chosen = np.random.default_rng(0).choice(len(train.names), options.held, replace=False)
        measure.report("training", [clouds[t] for t in chosen])


if __name__ == "__main__":
    main()
