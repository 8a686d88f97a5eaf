"""Say how much the results of several seeds differ, and what attributes do, with a taught noun and a known one.

    python -m bench.taught_variety mine.safetensors "a hydrant" hydrants/*.glb --known "a bottle"

Deforms the sphere by each noun with every seed, and prints the smallest and the mean distance between the results of
two seeds (the mean of the distances from points on one to the nearest on the other, both ways, in shares of the
diagonal), that between two meshes which were taught, and how height, width and depth change with each attribute. The
classifier of `bench/taught_retrieval.py` says which results look like the noun.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree

from bench.taught_retrieval import Classifier, deformed, pictures
from meshdeform.assets import load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.weld import weld
from meshdeform.priors import load_prior
from meshdeform.priors.builtin.teaching.pictures import shape_of
from meshdeform.requests.parameters import DeformParams
from meshdeform.runs.devices import use_threads
from training.evaluation.sources import source_mesh

ATTRIBUTES = ("tall", "short", "thin", "fat", "flat", "twisted")
_POINTS = 2_000


def points(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Return points drawn evenly from a surface, its box centred and its diagonal one."""
    corners = mesh.verts[mesh.faces].double().numpy()
    rng = np.random.default_rng(0)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[rng.choice(len(area), _POINTS, p=area / area.sum())]
    found: NDArray[np.float64] = (rng.dirichlet((1.0, 1.0, 1.0), _POINTS)[:, :, None] * chosen).sum(1)
    low, high = corners.min((0, 1)), corners.max((0, 1))
    return (found - (low + high) / 2) / float(np.linalg.norm(high - low))


def distances(meshes: Sequence[TriangleMesh]) -> list[float]:
    """Return the distance of every two surfaces, in shares of the diagonal."""
    drawn = [points(mesh) for mesh in meshes]
    trees = [KDTree(each) for each in drawn]
    return [
        float(trees[b].query(drawn[a])[0].mean() + trees[a].query(drawn[b])[0].mean()) / 2
        for a, b in itertools.combinations(range(len(drawn)), 2)
    ]


def proportions(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Return the sides of the box (x, y, z) over their geometric mean."""
    sides = (mesh.verts.amax(0) - mesh.verts.amin(0)).double().numpy()
    return np.asarray(sides / np.cbrt(sides.prod()))


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.taught_variety", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("weights", type=Path)
    parser.add_argument("prompt", help="a prompt of the taught noun alone")
    parser.add_argument("meshes", type=Path, nargs="+", help="what it was taught from")
    parser.add_argument("--known", default="a bottle", help="a prompt that the shipped prior knows, to compare with")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    use_threads(1)
    noun = options.prompt.removeprefix("a ").removeprefix("an ").strip()
    surfaces = [load_asset(path.read_bytes(), path.name).surface for path in options.meshes]
    taught = [weld(surface.positions, surface.triangles).mesh for surface in surfaces]
    classifier = Classifier(
        noun, [shape_of(mesh, path.name) for mesh, path in zip(taught, options.meshes, strict=True)], 8
    )
    print(f"of {classifier.tested} further members, {classifier.accuracy:.1%} are classified correctly", flush=True)
    prior, sphere = load_prior(str(options.weights), device="cpu"), source_mesh("sphere")

    def results(prompt: str) -> list[TriangleMesh]:
        told = [
            DeformParams.model_validate(
                {
                    "preset": "balanced",
                    "steps": options.steps,
                    "seed": seed,
                    "guidance": {"model": str(options.weights)},
                }
            )
            for seed in range(options.seeds)
        ]
        return [deformed(prior, sphere, prompt, params) for params in told]

    rows = []
    if len(taught) > 1:
        apart = distances(taught)
        print(f"the meshes that were taught: {min(apart):.3f} to {max(apart):.3f} apart, mean {np.mean(apart):.3f}")
    for prompt in (options.prompt, options.known):
        name = prompt.removeprefix("a ").removeprefix("an ").strip()
        plain = results(prompt)
        apart, right = distances(plain), sum(classifier.noun_of(mesh) == name for mesh in plain)
        print(
            f"{prompt}: seeds {min(apart):.3f} to {max(apart):.3f} apart, mean {np.mean(apart):.3f}; "
            f"{right} of {len(plain)} look like it",
            flush=True,
        )
        rows.append(pictures(plain))
        usual = np.mean([proportions(mesh) for mesh in plain], 0)
        row = plain[:1]
        for attribute in ATTRIBUTES:
            made = results(f"a {attribute} {name}")
            sides = np.array([proportions(mesh) for mesh in made]) / usual
            right = sum(classifier.noun_of(mesh) == name for mesh in made)
            told = ", ".join(
                f"{axis} {side.mean():.2f} ({side.min():.2f} to {side.max():.2f})"
                for axis, side in zip(("width", "height", "depth"), sides.T, strict=True)
            )
            print(f"  {attribute:<8} {told}; {right} of {len(made)} look like the noun", flush=True)
            row.append(made[0])
        rows.append(pictures(row))
    if options.picture:
        sheet = Image.new("RGB", (max(row.width for row in rows), sum(row.height for row in rows)), "white")
        for number, row_drawn in enumerate(rows):
            sheet.paste(row_drawn, (0, sum(each.height for each in rows[:number])))
        sheet.save(options.picture)


if __name__ == "__main__":
    main()
