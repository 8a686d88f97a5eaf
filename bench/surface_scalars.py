"""Learn scalars on surfaces, and say how far off they are where they were not learned.

python -m bench.surface_scalars spot.obj cow.obj

Each surface is fitted (base of 500 faces, 400 steps) and unfolded at level 3. Ten eigenfunctions, the heat of a source,
and six planted pieces of a fracture (cells of geodesic distance with a rough boundary) are learned at a random half of
the vertices, and compared at the other half: relative root mean squared error of scalars, share of wrong places of
pieces. `bytes` are those of the section.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.kinds.surface_fit.base_mesh import base_of
from meshdeform.kinds.surface_fit.cleaning import clean
from meshdeform.kinds.surface_fit.container import encode_base, write_field
from meshdeform.kinds.surface_fit.fitting import FieldFit, FieldFrame, FitOptions
from meshdeform.kinds.surface_fit.intrinsic import HeatGeodesics, delaunay, spectrum
from meshdeform.kinds.surface_fit.patches import level_of
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.scalar_fields import learn_scalars
from meshdeform.kinds.surface_fit.scalar_sections import read_scalars
from meshdeform.kinds.surface_fit.surface_sources import MeshSurface

_Floats = NDArray[np.float64]
LEVEL, PIECES, STEPS = 3, 6, 600


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


def rows(path: Path) -> Iterator[str]:
    """Return a row of the table for each task."""
    asset = load_asset(path.read_bytes(), path.name).surface
    surface = MeshSurface(clean(asset.positions, asset.triangles))
    frame = FieldFrame.around(surface.reference.verts)
    verts, faces = base_of(surface.reference, 500)
    base = encode_base(np.clip(frame.enter(verts), -1, 1), faces)
    fit = FieldFit(surface, frame, base.verts, base.faces, FitOptions(400))
    for _ in fit:
        pass
    level = level_of(base.faces, len(base.verts), LEVEL)
    verts = frame.leave(fit.positions(level.corners, level.weights))
    known, other = np.array_split(np.random.default_rng(0).permutation(len(verts)), 2)
    for task, values in targets(verts, level.faces).items():
        learned = learn_scalars(
            base.verts, level.corners[known], level.weights[known], values[known],
            labels=range(PIECES) if task == "pieces" else (), steps=STEPS,
        )  # fmt: skip
        place = {"centre": frame.centre, "scale": frame.scale}
        field = read_field(write_field(base, fit.field, **place, rounding=fit.rounding, scalars=[learned]))
        found, wanted = read_scalars(field)[0].values(level.corners, level.weights)[other], values[other]
        if task == "pieces":
            off = (found.argmax(1) != wanted.argmax(1)).mean()
        else:
            off = np.sqrt(((found - wanted) ** 2).mean(0) / (wanted**2).mean(0)).mean()
        yield f"| {path.stem} | {task} | {field.header['sections'][3][0]:,} | {off:.2%} |"


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("surfaces", type=Path, nargs="+")
    given = parser.parse_args()
    torch.set_num_threads(1)
    print("| surface | task | bytes | off by |\n|---|---|---|---|")
    for path in given.surfaces:
        for row in rows(path):
            print(row, flush=True)


if __name__ == "__main__":
    main()
