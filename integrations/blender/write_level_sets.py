"""Write tests/unit/assets/level_sets: small files of OpenVDB itself, which the tests of our reader read.

    scripts/test-blender -k nothing                      # installs bpy, which has OpenVDB 12 in it
    tests/.blender/bin/pip install tinyvdb==0.9.0
    tests/.blender/bin/python integrations/blender/write_level_sets.py

What is in `odd` is told by `odd_value`, with all the ways in which a node stores what is not active. OpenVDB packs with
Blosc; the same grid with zlib and unpacked is TinyVDB's, and OpenVDB reads it again here before it is kept.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import tinyvdb

bpy.utils.expose_bundled_modules()
import openvdb  # noqa: E402

FOLDER = Path(__file__).resolve().parents[2] / "tests/unit/assets/level_sets"


def odd_value(x: int, y: int, z: int) -> tuple[float, bool]:
    """Return a voxel's value, all of them halves exactly, and whether it is active; the tests have the same."""
    if (7 * x + 13 * y + 29 * z) % 3 == 0:
        return ((31 * x + 17 * y + 7 * z) % 64 - 32) / 64, True
    choices = [(0.5,), (-0.5,), (0.75,), (0.5, -0.5), (0.5, 0.75), (0.75, -0.625), (0.75, -0.625, 0.25, 0.5)][x // 8]
    return choices[(x + y + z) % len(choices)], False


def odd(kind: Any) -> Any:
    """Return the grid `odd` as a FloatGrid or a DoubleGrid."""
    grid = kind(0.5)
    grid.name, grid.gridClass = "odd", openvdb.GridClass.LEVEL_SET
    access = grid.getAccessor()
    for at in itertools.product(range(56), range(8), range(8)):
        value, active = odd_value(*at)
        (access.setValueOn if active else access.setValueOff)(at, value)
    grid.fill((0, 8, 0), (7, 15, 7), -0.25, True)  # one tile each: active, and not
    grid.fill((8, 8, 0), (15, 15, 7), 0.25, False)
    grid.transform = openvdb.createLinearTransform([[0.5, 0, 0, 0], [0, 0.25, 0, 0], [0, 0, 2, 0], [1, 2, 3, 1]])
    return grid


def main() -> None:
    """Write the files, and read them again."""
    FOLDER.mkdir(exist_ok=True)
    ball = openvdb.createLevelSetSphere(1.0, (1.83, 1.7, 2.0), 0.25, 3.0)
    ball.name = "ball"
    fog = openvdb.FloatGrid(0.0)
    fog.fill((0, 0, 0), (7, 7, 7), 1.0)
    fog.name, fog.gridClass = "density", openvdb.GridClass.FOG_VOLUME
    turned = ball.deepCopy()
    turned.transform = openvdb.createLinearTransform([[0, 0.25, 0, 0], [-0.25, 0, 0, 0], [0, 0, 0.25, 0], [0, 0, 0, 1]])
    half = odd(openvdb.FloatGrid)
    half.saveFloatAsHalf = True
    other = ball.deepCopy()
    other.name = "other"
    files = {
        "ball": [fog, ball], "fog": [fog], "turned": [turned], "two": [ball, other],
        "odd": [odd(openvdb.FloatGrid)], "odd_half": [half], "odd_double": [odd(openvdb.DoubleGrid)],
    }  # fmt: skip
    for name, grids in files.items():
        openvdb.write(str(FOLDER / f"{name}.vdb"), grids=grids)
    with tinyvdb.open(str(FOLDER / "odd.vdb")) as packed:
        packed.read_grids()
        for name, how in {
            "odd_zip": tinyvdb.COMPRESS_ZIP | tinyvdb.COMPRESS_ACTIVE_MASK,
            "odd_zip_all": tinyvdb.COMPRESS_ZIP,
            "odd_plain": tinyvdb.COMPRESS_ACTIVE_MASK,
        }.items():
            (FOLDER / f"{name}.vdb").write_bytes(packed.to_bytes(compression=how))
    for path in sorted(FOLDER.glob("odd*.vdb")):
        values = np.zeros((56, 8, 8), np.float64 if path.stem == "odd_double" else np.float32)
        openvdb.readAll(str(path))[0][0].copyToArray(values)
        wanted = [odd_value(*at)[0] for at in itertools.product(range(56), range(8), range(8))]
        assert (values.ravel() == wanted).all(), path
        print(path.name, path.stat().st_size)


if __name__ == "__main__":
    main()
