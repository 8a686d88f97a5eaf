"""Fit tori of a level set whose tubes are few cells thick, and say how far off they are, as shares of their radius.

python -m bench.thin_tubes
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets.surface_files import DistanceGrid
from meshdeform.kinds.surface_fit.base_mesh import base_of
from meshdeform.kinds.surface_fit.container import encode_base
from meshdeform.kinds.surface_fit.fitting import FieldFit, FieldFrame, FitOptions
from meshdeform.kinds.surface_fit.measures import distances
from meshdeform.kinds.surface_fit.patches import level_of
from meshdeform.kinds.surface_fit.surface_sources import surface_of

BASE_FACES, STEPS = 500, 300
CELL, BAND = 2 / 128, 3
"""For a torus of radius 1; the distances end at three cells, as OpenVDB's do."""


def level_set(tube: float) -> DistanceGrid:
    """Return the distances of a torus around z; no value lies on its planes of symmetry."""
    size = np.array([1 + tube, 1 + tube, tube]) + 4 * CELL
    count = np.ceil(2 * size / CELL).astype(int) + 1
    origin = -CELL * (count - 1) / 2 + CELL * np.array([0.013, 0.007, 0.021])
    at = np.stack(np.meshgrid(*[origin[i] + CELL * np.arange(count[i]) for i in range(3)], indexing="ij"), -1)
    return DistanceGrid(np.clip(inside(at, tube), -BAND * CELL, BAND * CELL), origin, np.full(3, CELL))


def inside(at: NDArray[np.float64], tube: float) -> NDArray[np.float64]:
    """Return signed distances of places (..., 3) from the torus."""
    return np.asarray(np.hypot(np.hypot(at[..., 0], at[..., 1]) - 1, at[..., 2]) - tube)


def main() -> None:
    """Print a line for each thickness and fit."""
    torch.set_num_threads(1)
    source = FitOptions(STEPS, batch_faces=48)
    print("| cells | steps | base | mean | greatest | distance |\n|---|---|---|---|---|---|")
    for cells, options in ((2, source), (3, source), (4, source), (6, source), (6, FitOptions(400))):
        tube = cells / 2 * CELL
        surface = surface_of(level_set(tube))
        frame = FieldFrame.around(surface.reference.verts)
        verts, faces = base_of(surface.reference, BASE_FACES)
        base = encode_base(np.clip(frame.enter(verts), -1, 1), faces)
        fit = FieldFit(surface, frame, base.verts, base.faces, options)
        for _ in fit:
            pass
        level = level_of(base.faces, len(base.verts), 2)
        found = frame.leave(fit.positions(level.corners, level.weights))
        off = np.abs(inside(found, tube)) / tube
        apart = distances(surface, found, level.faces)["mean"]
        row = (cells, options.steps, len(faces), f"{off.mean():.1%}", f"{off.max():.0%}", f"{apart:.3%}")
        print(f"| {' | '.join(map(str, row))} |", flush=True)


if __name__ == "__main__":
    main()
