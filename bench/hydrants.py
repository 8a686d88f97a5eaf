"""Write hydrants, meshes of a noun that the shipped prior does not know: ``bench/hydrants.py 10 hydrants``.

A hydrant stands on a flange, has a ribbed or plain barrel, a domed cap with a nut, a large outlet in front (+Z) and two
small ones at its sides. Every length is drawn from the number of the hydrant, so that the ten differ as the products of
ten makers do.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a script finds its own folder only

from meshdeform.assets import build_glb
from meshdeform.support.files import write_files
from training.prior.families.parts import Part, disc, join, lathe, moved, pair, turned

_SEED = 0x68796472
"""First word of the seeds of all hydrants ("hydr")."""


def hydrant(number: int) -> Part:
    """Draw the hydrant of a number; the same for the same number."""
    rng = np.random.default_rng([_SEED, number])
    girth, tall = rng.uniform(0.26, 0.4), rng.uniform(0.8, 1.4)
    foot, cap, taper = girth * rng.uniform(1.3, 1.6), girth * rng.uniform(1.05, 1.3), rng.uniform(0.82, 1.0)
    height = tall * rng.uniform(0.6, 0.72)
    dome = np.linspace(0.0, 0.5 * np.pi, 7)[:-1]
    rise = girth * rng.uniform(0.6, 1.2)
    parts = [
        disc(foot, 0.0, 0.12),
        lathe([(girth, 0.08), (girth * taper, tall)]),
        disc(cap, tall - 0.05, tall + 0.08),
        lathe([(girth * taper * np.cos(t), tall + 0.06 + rise * np.sin(t)) for t in dome]),
        moved(lathe([(0.09, 0.0), (0.09, 0.16)], segments=5), [0.0, tall + rise, 0.0]),
    ]
    if rng.random() < 0.5:
        parts += [disc(girth * 1.12, at * tall, at * tall + 0.07, edge=0.02) for at in (0.25, 0.42)]
    small, large = rng.uniform(0.11, 0.15), rng.uniform(0.16, 0.24)
    reach, bolt = rng.uniform(0.16, 0.34), rng.uniform(0.05, 0.08)
    side = [disc(small, 0.0, girth + reach), disc(small + 0.05, girth + reach - 0.14, girth + reach - 0.02)]
    side.append(disc(bolt, 0.0, girth + reach + 0.1, edge=0.02))
    parts += [each for part in side for each in pair(moved(turned(part, -90, "z"), [0.0, height, 0.0]))]
    front = [disc(large, 0.0, girth + 0.6 * reach), disc(large + 0.05, girth + 0.3 * reach, girth + 0.55 * reach)]
    return join([*parts, *(moved(turned(part, 90, "x"), [0.0, height * 0.92, 0.0]) for part in front)])


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("count", type=int)
    parser.add_argument("folder", type=Path)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for number in range(options.count):
        part = hydrant(number)
        write_files({options.folder / f"hydrant_{number:02d}.glb": build_glb(part.verts, part.faces)})


if __name__ == "__main__":
    main()
