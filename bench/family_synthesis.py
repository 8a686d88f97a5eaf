"""Measure new shapes of families against members that were held out.

    python bench/family_synthesis.py chairs airplanes cars/ --seeds 3

A family is one of `bench.parametric_families`, of 64 members, or a folder of assets with or without `labels.json`, as
`bench/family_kits.py` makes them. Each is fitted by the whole job with the default parameters, but for the machine,
which draws nothing. Half of the members are held out of what follows: new shapes are drawn near the others only, and
take parts from these only. The linear model has the principal components of the same places and of which points exist,
with normal coefficients. `training` are members themselves.

Shapes are compared by the Chamfer distance of samples of their surfaces, with the diagonal as unit: the mean distance
of held-out members to the nearest shape (minimum matching distance, less is better), the share of held-out members that
are the nearest one of a shape (coverage, more is better), and how often the nearest neighbour of a shape or a held-out
member is of the same group (1-NN accuracy, 50 % is best). Sources: Achlioptas et al. 2018, Yang et al. 2019. `copies`
is the share of shapes that are nearer to a training member than 95 % of the held-out members are (5 % is best), and
`mixed` the share whose parts are of members of more than one sub-class. The seeds draw the members, the halves and the
shapes. Figures are means over shapes or held-out members of all seeds, with half of the 95 % interval. The last rows
are differences from shapes near members, of the same held-out members where these are what is counted.

    python bench/family_synthesis.py chairs cars/ --scores

measures in place of this how often a held-out member scores better than a shape that has each part of some held-out
member: by the free energy of a machine that learns the others with the default parameters, and by the distance to the
nearest of the others.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a script finds its own folder only

from bench.family_accuracy import collection_of, fitted
from bench.parametric_families import PARTS
from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.assemble import assemble
from meshdeform.assets.collection import open_collection
from meshdeform.assets.family_file import FamilyFile, read_family
from meshdeform.kinds.families.assembly import Assembler
from meshdeform.kinds.families.boundary import boundary_defects
from meshdeform.kinds.families.collection import sample_shape
from meshdeform.kinds.families.inference import graph
from meshdeform.kinds.families.learning import Learning
from meshdeform.kinds.families.machine import BetaMachine
from meshdeform.kinds.families.members import turned
from meshdeform.kinds.families.sampling import LACKING, Drawn, FreeEnergy, sampled, to_machine

_SAMPLES, _MEMBERS, _EPOCHS = 600, 64, 300
_MEASURES = ("distance", "coverage", "1-NN", "copies", "mixed")

Cloud = NDArray[np.float64]


def ordered(found: FamilyFile, order: NDArray[np.int64]) -> FamilyFile:
    """Return the family with these of its members."""
    arrays = ("points", "triangles", "exists", "centres", "diagonals", "turns")
    lists = ("names", "digests", "segments")
    chosen = {name: getattr(found, name)[order] for name in arrays}
    return dataclasses.replace(found, **chosen, **{name: [getattr(found, name)[t] for t in order] for name in lists})


def linear(train: FamilyFile, random: np.random.Generator) -> Drawn:
    """Draw a shape from the principal components of places and existence that have 95 % of the variance."""
    exists = train.exists.astype(float)
    mean = (train.points * exists[:, :, None]).sum(0) / np.maximum(exists.sum(0), 1)[:, None]
    filled = np.where(train.exists[:, :, None], train.points, mean).reshape(len(exists), -1)
    rows = np.concatenate([filled, 0.2 * exists], 1)  # so that both parts have about the same variance
    centre = rows.mean(0)
    _, values, axes = np.linalg.svd(rows - centre, full_matrices=False)
    kept = int((np.cumsum(values**2) < 0.95 * (values**2).sum()).sum()) + 1
    drawn = centre + (random.normal(size=kept) * values[:kept] / np.sqrt(len(rows))) @ axes[:kept]
    points, there = drawn[: filled.shape[1]].reshape(-1, 3), drawn[filled.shape[1] :] > 0.1
    # Each part is of the member whose points are nearest to those drawn, where enough of them are there.
    nearest = np.where(there & train.exists, np.linalg.norm(train.points - points, axis=2), np.nan)
    sources = {}
    for part in range(len(train.parts)):
        own = train.labels == part
        if there[own].mean() > 0.5 * train.exists[:, own].mean():
            apart = [each[np.isfinite(each)].mean() if np.isfinite(each).any() else 9.0 for each in nearest[:, own]]
            sources[part] = np.argsort(apart).tolist()
    return Drawn(points, there, sources)


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

    def measured(self, made: list[Cloud]) -> list[Tensor]:
        """Return what the first four of `_MEASURES` are means of; there are as many shapes as held-out members."""
        across, count = chamfer(made, self.held), len(made)
        both = torch.cat([torch.cat([chamfer(made, made), across], 1), torch.cat([across.T, self.within], 1)])
        group = torch.arange(2 * count) < count
        nearest = both.fill_diagonal_(torch.inf).argmin(1)
        return [
            across.amin(0),
            torch.bincount(across.argmin(1), minlength=count) > 0,
            group[nearest] == group,
            chamfer(made, self.train).amin(1) < self.copy,
        ]


def scores(name: str, seed: int) -> dict[str, float]:
    """Return how often the two scores tell a held-out member from a shape of parts of several."""
    whole = read_family(
        fitted(collection_of(name, _MEMBERS, seed), {"seed": seed, "epochs": 1})[1]["family.safetensors"].data
    )
    random, count = np.random.default_rng(seed), len(whole.names)
    order = random.permutation(count)
    train, held = (ordered(whole, each) for each in (order[: count - count // 2], order[count - count // 2 :]))

    def seen(points: Cloud, exists: NDArray[np.bool_]) -> tuple[Tensor, Tensor]:
        scaling = torch.from_numpy(whole.scaling.copy())
        return to_machine(torch.from_numpy(points).float(), scaling), torch.from_numpy(exists).float()

    coins, labels = torch.Generator().manual_seed(seed), torch.from_numpy(whole.labels.astype(np.int64))
    known = seen(train.points, train.exists)
    edges = graph(known[0].mean(0), labels)
    learning = Learning.start(BetaMachine.start(*known, labels, coins), *known, edges, coins)
    for _ in range(_EPOCHS):
        learning.step(_EPOCHS)
    energy = FreeEnergy(learning.finished(), *known)
    owners = random.integers(len(held.names), size=(4 * len(held.names), len(whole.parts)))[:, whole.labels]
    mixed = held.points[owners, np.arange(len(whole.labels))], held.exists[owners, np.arange(len(whole.labels))]
    found = {}
    for title, score in (
        ("machine", lambda points, exists: energy(*seen(points, exists)).numpy()),
        ("nearest member", lambda points, exists: np.array([*map(partial(_nearest, train), points, exists)])),
    ):
        good, bad = score(held.points, held.exists), score(*mixed)
        found[title] = float((good[:, None] < bad).mean() + (good[:, None] == bad).mean() / 2)
    return found


def _nearest(train: FamilyFile, points: Cloud, exists: NDArray[np.bool_]) -> float:
    """Return how far the nearest member is from a shape."""
    both = exists & train.exists
    apart = (np.linalg.norm(train.points - points, axis=2) * both).sum(1) / np.maximum(both.sum(1), 1)
    return float((apart + LACKING * (train.exists != exists).mean(1)).min())


def measured(name: str, seed: int) -> dict[str, list[Tensor]]:
    """Return what `_MEASURES` are means of, for each model of one family and seed."""
    data = collection_of(name, _MEMBERS, seed)
    files = open_collection(data, Limits())
    whole = read_family(fitted(data, {"seed": seed, "epochs": 1})[1]["family.safetensors"].data)
    count = len(whole.names)
    whole = ordered(whole, np.random.default_rng(seed).permutation(count))
    train = ordered(whole, np.arange(count - count // 2))
    assets = [load_asset(files.assets[each], each) for each in whole.names]
    labels = files.labels.assets if files.labels else {}
    kinds = [labels[each].class_ if each in labels else None for each in whole.names]
    surfaces = [asset.surface for asset in assets]
    cuts = zip(surfaces, train.segments, strict=False)
    defects = np.stack([boundary_defects(s.positions, s.triangles, each, len(train.parts)) for s, each in cuts])
    assembler = Assembler(train, lambda member: assets[member], defects, 0.25)
    mixed: list[bool] = []

    def built(drawn: Drawn) -> Asset:
        choice = assembler.chosen(drawn)
        mixed.append(len({kinds[member] for member in choice.values()}) > 1)
        size = {"diagonal": 1.0, "centre": np.zeros(3)}
        return load_asset(assemble(assembler.assemble(drawn.points, drawn.exists, choice, **size).pieces))

    clouds = [cloud(asset, t, float(whole.turns[t])) for t, asset in enumerate(assets)]
    measure = Yardstick.of(clouds[len(train.names) :], clouds[: len(train.names)])
    makers: dict[str, Callable[[np.random.Generator], Asset]] = {
        "near members": lambda random: built(sampled(train, random)),
        "linear": lambda random: built(linear(train, random)),
    }
    found: dict[str, list[Tensor]] = {}
    for title, make in makers.items():
        random = np.random.default_rng(seed)
        mixed.clear()
        made = [cloud(make(random), number) for number in range(count // 2)]
        found[title] = [*measure.measured(made), torch.tensor(mixed)]
    found["training"] = [*measure.measured(clouds[: count // 2]), torch.zeros(1)]
    return found


def shown(items: Tensor) -> str:
    """Return the mean of items (N,) and half of its 95 % interval."""
    return f"{items.mean():.4f} ± {1.96 * items.std() / len(items) ** 0.5:.4f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("families", nargs="+", help=f"{', '.join(sorted(PARTS))}, or a folder")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--scores", action="store_true", help="measure scores of shapes, and make none")
    options = parser.parse_args()
    torch.set_num_threads(1)
    for name in options.families:
        if options.scores:
            told = [scores(name, seed) for seed in range(options.seeds)]
            print(name, *(f"{each} {shown(torch.tensor([t[each] for t in told]))}" for each in told[0]), flush=True)
            continue
        found = [measured(name, seed) for seed in range(options.seeds)]
        print(f"{name:34}" + "".join(f"{each:>18}" for each in _MEASURES))
        pooled = {
            title: [torch.cat(each).double() for each in zip(*(f[title] for f in found), strict=True)]
            for title in found[0]
        }
        near = pooled["near members"]
        rows = {title: [shown(items) for items in values] for title, values in pooled.items()}
        for title in list(pooled)[1:]:
            rows[f"near members less {title}"] = [
                shown(a - b) if len(a) == len(b) else "" for a, b in zip(near, pooled[title], strict=True)
            ]
        for title, cells in rows.items():
            print(f"  {title:32}" + "".join(f"{cell:>18}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
