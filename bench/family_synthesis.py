"""Measure new shapes of a fitted family beside a linear model and its members: coverage, novelty, and how parts meet.

    python -m bench.family_synthesis chairs-family --count 60

`chairs-family` is the folder of a `meshdeform family-fit` with `--set embed_labels=true`. `parts of members` draws
shapes as `family_synthesize` does; `linear model` draws them from the principal components of the members' places and
of which points exist, with normal coefficients, and builds them of the nearest members' parts in the same way; and
`nearest member` answers each of its draws with the whole member that is nearest.

Shapes are compared by the Chamfer distance of 1,500 samples of their surfaces, with the diagonal as unit: `coverage` is
the number of members that are the nearest one of some shape, `novelty` the mean distance of a shape from its nearest
member (members: from the nearest other one), `noise` that of two samplings of one member. `one member`: shapes all of
whose parts are of one member; `apart`: different nearest members among the first twelve shapes. `meets`: shapes without
a gap or a penetration over 0.8 % of the diagonal, `worst` the widest of all. Seconds are of the CPU, for all shapes,
reading of members included.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.assemble import AssetPart
from meshdeform.assets.collection import open_collection
from meshdeform.geometry.surface_samples import surface_samples
from meshdeform.kinds.families.assembly import Assembler
from meshdeform.kinds.families.family_file import FamilyFile, read_family
from meshdeform.kinds.families.members import turned
from meshdeform.kinds.families.sampling import LACKING, Drawn, sampled

_SAMPLES, _GOOD, _FIRST = 1500, 0.008, 12
_KEPT_VARIANCE, _OF_EXISTENCE, _PRESENT = 0.95, 0.2, 0.5

Cloud = NDArray[np.float64]


@dataclass
class Made:
    """The shapes of a model: samples of each, how its parts meet, and whether all are of one member."""

    clouds: list[Cloud] = field(default_factory=list)
    faults: list[float] = field(default_factory=list)
    copies: int = 0
    seconds: float = 0.0


class LinearModel:
    """The principal components of places and existence that have 95 % of the variance."""

    def __init__(self, family: FamilyFile) -> None:
        self._family = family
        exists = family.exists.astype(float)
        mean = (family.points * exists[:, :, None]).sum(0) / np.maximum(exists.sum(0), 1)[:, None]
        filled = np.where(family.exists[:, :, None], family.points, mean).reshape(len(exists), -1)
        rows = np.concatenate([filled, _OF_EXISTENCE * exists], 1)  # so that both parts have about the same variance
        self._centre, self._places = rows.mean(0), filled.shape[1]
        _, values, axes = np.linalg.svd(rows - self._centre, full_matrices=False)
        kept = int((np.cumsum(values**2) < _KEPT_VARIANCE * (values**2).sum()).sum()) + 1
        self._axes = axes[:kept] * values[:kept, None] / np.sqrt(len(rows))

    def draw(self, random: np.random.Generator) -> Drawn:
        """Return a shape; each part is given by the member whose points are nearest to those drawn."""
        family = self._family
        drawn = self._centre + random.normal(size=len(self._axes)) @ self._axes
        points, there = drawn[: self._places].reshape(-1, 3), drawn[self._places :] > _OF_EXISTENCE / 2
        apart = np.where(there & family.exists, np.linalg.norm(family.points - points, axis=2), np.nan)
        sources = {}
        for part in range(len(family.parts)):
            own = family.labels == part
            if there[own].mean() > _PRESENT * family.exists[:, own].mean():
                far = [each[np.isfinite(each)].mean() if np.isfinite(each).any() else np.inf for each in apart[:, own]]
                sources[part] = np.argsort(far, kind="stable").tolist()
        return Drawn(points, there, sources)

    def nearest(self, drawn: Drawn) -> int:
        """Return the member that is nearest to a shape."""
        both = drawn.exists & self._family.exists
        apart = (np.linalg.norm(self._family.points - drawn.points, axis=2) * both).sum(1) / np.maximum(both.sum(1), 1)
        return int((apart + LACKING * (self._family.exists != drawn.exists).mean(1)).argmin())


def cloud(positions: Cloud, triangles: NDArray[np.int64], seed: int) -> Cloud:
    """Return samples of a surface, in the middle of its box and with the diagonal as unit."""
    points = surface_samples(positions, triangles, _SAMPLES, seed)[0]
    low, high = positions[triangles].min((0, 1)), positions[triangles].max((0, 1))
    centred: Cloud = (points - (low + high) / 2) / float(np.linalg.norm(high - low))
    return centred


def of_pieces(pieces: list[AssetPart], seed: int) -> Cloud:
    """Return samples of a shape of parts."""
    faces = [piece.asset.surface.triangles[piece.triangles] for piece in pieces]
    starts = np.cumsum([0, *(len(piece.positions) for piece in pieces)])
    every = np.concatenate([face + start for face, start in zip(faces, starts, strict=False)])
    return cloud(np.concatenate([piece.positions for piece in pieces]), every, seed)


def chamfer(one: list[Cloud], other: list[Cloud]) -> Cloud:
    """Return the Chamfer distances (A, B): the means both ways, and of the two their mean."""
    trees = [cKDTree(each) for each in one], [cKDTree(each) for each in other]
    there = np.array([[tree.query(each)[0].mean() for tree in trees[1]] for each in one])
    back = np.array([[tree.query(each)[0].mean() for each in other] for tree in trees[0]])
    return np.asarray((there + back) / 2)


def built(family: FamilyFile, load: Callable[[int], Asset], draws: Iterator[Drawn]) -> Made:
    """Return the shapes of draws, made of parts of the members."""
    assembler, made, began = Assembler(family, load), Made(), time.process_time()
    for number, draw in enumerate(draws):
        choice = assembler.chosen(draw)
        assembly = assembler.assemble(draw.points, draw.exists, choice, diagonal=1.0, centre=np.zeros(3))
        made.seconds += time.process_time() - began
        made.faults.append(max(max(part.gap, part.penetration) for part in assembly.parts))
        made.copies += len({part.member for part in assembly.parts}) == 1
        made.clouds.append(of_pieces(assembly.pieces, number))
        began = time.process_time()
    return made


def row(title: str, made: Made, members: list[Cloud]) -> str:
    """Return a line of the table."""
    apart = chamfer(made.clouds, members)
    nearest, faults = apart.argmin(1), np.array(made.faults)
    return (
        f"| {title} | {len(set(nearest.tolist()))} of {len(members)} | {apart.min(1).mean():.4f} | {made.copies} "
        f"| {len(set(nearest[:_FIRST].tolist()))} | {int((faults <= _GOOD).sum())} of {len(faults)} "
        f"| {faults.max():.2%} | {made.seconds:.1f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("family", type=Path, help="folder of a fit with labelled.zip")
    parser.add_argument("--count", type=int, default=60, help="shapes of each model")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    family = read_family((options.family / "family.safetensors").read_bytes(), Limits.unlimited())
    files = open_collection((options.family / "labelled.zip").read_bytes(), Limits.unlimited()).assets
    stems = {Path(name).stem: data for name, data in files.items()}

    def load(member: int) -> Asset:
        return load_asset(stems[Path(family.names[member]).stem], "member.glb", Limits.unlimited())

    surfaces = [load(member).surface for member in range(len(family.names))]
    frames = [turned(s.positions, float(t)) for s, t in zip(surfaces, family.turns, strict=True)]
    members, again = (
        [cloud(frame, surface.triangles, seed) for frame, surface in zip(frames, surfaces, strict=True)]
        for seed in (1000, 1001)
    )
    between, noise = chamfer(members, members), np.diag(chamfer(members, again))
    np.fill_diagonal(between, np.inf)
    print(f"members: {between.min(1).mean():.4f} from the nearest other one, noise {noise.mean():.4f}")
    print("| | coverage | novelty | one member | apart | meets | worst | CPU s |\n|---|---|---|---|---|---|---|---|")
    draws = (sampled(family, number, options.seed) for number in range(options.count))
    print(row("parts of members", built(family, load, draws), members), flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    model, random = LinearModel(family), np.random.default_rng(options.seed)
    drawn = [model.draw(random) for _ in range(options.count)]
    print(row("linear model", built(family, load, iter(drawn)), members), flush=True)
    nearest = [members[model.nearest(each)] for each in drawn]
    print(row("nearest member", Made(nearest, [0.0] * len(nearest), len(nearest)), members))
    print(f"peak of the first row: {peak} MiB")


if __name__ == "__main__":
    main()
