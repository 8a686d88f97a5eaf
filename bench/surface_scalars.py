"""Learn scalars on a surface by features of its base, and by an MLP of the same size on points of space.

python bench/make_surfaces.py FOLDER
python -m bench.surface_scalars FOLDER/bumpy_torus.glb spot.obj --table

Each surface is fitted (base of about 500 faces, 400 steps) and unfolded at level 3. Ten eigenfunctions, the heat of a
source, and six planted pieces of a fracture (cells of geodesic distance with a rough boundary) are learned at a random
half of the vertices, with as many steps and weights each, and compared at the other half: relative root mean squared
error of scalars, share of wrong places of pieces. `--keep FOLDER` also writes NAME.npz, the values at all vertices, as
`meshdeform surface-fit --scalars` takes them.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from bench.surface_pareto import fitted
from bench.surface_rivals import read_source
from meshdeform.deformation.variables import Adam
from meshdeform.kinds.surface_fit.intrinsic import HeatGeodesics, delaunay, spectrum
from meshdeform.kinds.surface_fit.network import octaves_of
from meshdeform.kinds.surface_fit.patches import level_of
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.scalar_fields import learn_scalars
from meshdeform.kinds.surface_fit.scalar_sections import read_scalars
from meshdeform.kinds.surface_fit.surface_sources import surface_of

_Floats = NDArray[np.float64]
LEVEL, PIECES, WIDTH, DEPTH = 3, 6, 32, 2


def targets(verts: _Floats, faces: NDArray[np.int64]) -> dict[str, _Floats]:
    """Return values (V, C) of each task at the vertices."""
    mesh = delaunay(verts, faces)
    _, functions = spectrum(mesh, 11)
    solver = HeatGeodesics(mesh)
    far = solver.distances([0])
    width = 0.1 * far.max()
    seeds = [int(far.argmax())]
    cells = [solver.distances(seeds)]
    while len(seeds) < PIECES:
        seeds.append(int(np.min(cells, axis=0).argmax()))
        cells.append(solver.distances([seeds[-1]]))
    size = np.linalg.norm(np.ptp(verts, axis=0))
    rough = [0.03 * cells[0].max() * np.sin(60 * verts @ np.roll([0.9, 0.3, 0.5], k) / size) for k in range(PIECES)]
    owner = np.argmin(np.array(cells) + rough, axis=0)
    return {
        "ten eigenfunctions": functions[:, 1:],
        "heat of a source": np.exp(-((far / width) ** 2) / 4)[:, None],
        "pieces": (owner[:, None] == np.arange(PIECES)).astype(float),
    }


def points_mlp(points: _Floats, values: _Floats, octaves: int, weights: int, steps: int, *, classes: bool) -> Any:
    """Return a function of points: an MLP with about as many weights, learned as `learn_scalars` does."""
    inputs, outputs = 3 + 6 * octaves, values.shape[1]
    # Two hidden layers of h: inputs h + h^2 + outputs h + 2 h weights.
    h = int((-(inputs + outputs + 2) + math.sqrt((inputs + outputs + 2) ** 2 + 4 * weights)) / 2)
    generator = torch.Generator().manual_seed(0)
    layers = [
        (torch.randn(b, a, generator=generator) * math.sqrt(2 / a), torch.zeros(b))
        for a, b in itertools.pairwise([inputs, h, h, outputs])
    ]
    low, size = points.min(0), np.ptp(points, axis=0).max()
    middle, spread = (0.0, 1.0) if classes else (values.mean(0), values.std(0))
    wanted = torch.from_numpy((values - middle) / spread).float()

    def enter(given: _Floats) -> Tensor:
        return octaves_of(torch.from_numpy(2 * (given - low) / size - 1).float(), octaves)

    def run(x: Tensor) -> Tensor:
        for weight, bias in layers[:-1]:
            x = functional.silu(functional.linear(x, weight, bias))
        return functional.linear(x, *layers[-1])

    encoded = enter(points)
    flat = [tensor.requires_grad_() for layer in layers for tensor in layer]
    optimizer = Adam([{"params": flat, "lr": 0.0}])
    for step in range(steps):
        rows = torch.randint(0, len(values), (4096,), generator=generator)
        found = run(encoded[rows])
        loss = (
            functional.binary_cross_entropy_with_logits(found, wanted[rows])
            if classes
            else (found - wanted[rows]).square().mean()
        )
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.param_groups[0]["lr"] = 0.01 * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * step / steps)))
        optimizer.step()
    with torch.no_grad():
        return lambda given: run(enter(given)).detach().double().numpy() * spread + middle


def measure(path: Path, steps: int, keep: Path | None) -> list[dict[str, Any]]:
    """Return a row for each task."""
    source = read_source(path.read_bytes(), path.name)
    begin = time.process_time()
    write = fitted(surface_of(source), 500, WIDTH, 400)
    data = write()
    field = read_field(data)
    fit_s = time.process_time() - begin
    level = level_of(field.faces, len(field.verts), LEVEL)
    begin = time.process_time()
    verts, faces = read_field(data).unfold(LEVEL)
    unfold_s = time.process_time() - begin
    known, other = np.array_split(np.random.default_rng(0).permutation(len(verts)), 2)
    rows = []
    tasks = targets(verts, faces)
    if keep is not None:
        kept = {**tasks, "pieces": tasks["pieces"].argmax(1)}
        np.savez(keep / f"{path.stem}.npz", points=verts, **kept)
    for task, values in tasks.items():
        classes = task == "pieces"
        ours = learn_scalars(
            field.verts, level.corners[known], level.weights[known], values[known],
            labels=range(PIECES) if classes else (), width=WIDTH, depth=DEPTH, steps=steps,
        )  # fmt: skip
        size = sum(tensor.numel() for tensor in ours.tensors)
        file = write(scalars=[ours])
        begin = time.process_time()
        found = read_scalars(read_field(file))[0].values(level.corners, level.weights)
        row = {
            "surface": path.stem, "task": task, "places": len(verts), "weights": size,
            "bytes": read_field(file).header["sections"][3][0],
            "intrinsic": _error(found[other], values[other], classes=classes),
            "prepare_s": unfold_s + time.process_time() - begin, "fit_s": fit_s,
        }  # fmt: skip
        for name, octaves in (("points", 0), ("points, 6 octaves", 6)):
            rival = points_mlp(verts[known], values[known], octaves, size, steps, classes=classes)
            row[name] = _error(rival(verts[other]), values[other], classes=classes)
        rows.append(row)
        print(json.dumps(row), flush=True)
    return rows


def _error(found: _Floats, wanted: _Floats, *, classes: bool) -> float:
    if classes:
        return float((found.argmax(1) != wanted.argmax(1)).mean())
    return float(np.mean(np.sqrt(((found - wanted) ** 2).mean(0) / (wanted**2).mean(0))))


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("surfaces", type=Path, nargs="+")
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    torch.set_num_threads(1)
    rows = [row for path in given.surfaces for row in measure(path, given.steps, given.keep)]
    if given.table:
        print("| surface | task | bytes | intrinsic | MLP on points | with 6 octaves |\n|---|---|---|---|---|---|")
        for row in rows:
            print(
                f"| {row['surface']} | {row['task']} | {row['bytes']:,} | {row['intrinsic']:.2%} | {row['points']:.2%} "
                f"| {row['points, 6 octaves']:.2%} |"
            )


if __name__ == "__main__":
    main()
