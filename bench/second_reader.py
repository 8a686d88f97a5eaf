"""Compare our reading of mesh files with trimesh's: ``python -m bench.second_reader FOLDER [FOLDER ...]``.

Every OBJ, PLY and STL below the folders is read by both, with the files beside it. Compared are the number of
triangles, their area, the bounds, and whether texture coordinates and colours arrived. Each difference is printed: one
of the two is wrong then, and it is not always the other.
"""

from __future__ import annotations

import argparse
import collections
import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.bundle import read_with_files
from meshdeform.errors import MeshdeformError

Facts = dict[str, Any]


def facts(positions: NDArray[np.float64], triangles: NDArray[np.int64], *, uvs: bool, colors: bool) -> Facts:
    """Return what is compared."""
    a, b, c = positions[triangles].transpose(1, 0, 2)
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    used = positions[np.unique(triangles)]
    return {
        "triangles": len(triangles),
        "area": area,
        "bounds": np.concatenate([used.min(0), used.max(0)]),
        "uvs": uvs,
        "colors": colors,
    }


def ours(path: Path) -> Facts:
    """Read a file by the product."""
    asset = load_asset(read_with_files(path, Limits.unlimited()), path.name, Limits.unlimited())
    glb = asset.to_bytes()
    root = json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])
    names = {name for mesh in root["meshes"] for each in mesh["primitives"] for name in each["attributes"]}
    surface = asset.surface
    return facts(surface.positions, surface.triangles, uvs="TEXCOORD_0" in names, colors="COLOR_0" in names)


def theirs(path: Path) -> Facts:
    """Read a file by trimesh."""
    import trimesh

    scene: Any = trimesh.load_scene(path, process=False, maintain_order=True)
    meshes = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    mesh: Any = trimesh.util.concatenate(meshes)
    looks = [each.visual for each in meshes]
    colors = any(look.kind in {"vertex", "face"} for look in looks)
    uvs = any(getattr(look, "uv", None) is not None for look in looks)
    return facts(np.asarray(mesh.vertices), np.asarray(mesh.faces), uvs=uvs, colors=colors)


def differences(mine: Facts, other: Facts) -> list[str]:
    """Return a sentence for each difference."""
    size = float(np.linalg.norm(mine["bounds"][3:] - mine["bounds"][:3])) or 1.0
    found = [
        f"{name}: {mine[name]} and {other[name]}"
        for name in ("triangles", "uvs", "colors")
        if mine[name] != other[name]
    ]
    if abs(mine["area"] - other["area"]) > 1e-5 * max(mine["area"], other["area"]):
        found.append(f"area: {mine['area']:.7g} and {other['area']:.7g}")
    if not np.allclose(mine["bounds"], other["bounds"], rtol=0, atol=1e-5 * size):
        found.append(f"bounds: {np.round(mine['bounds'], 4).tolist()} and {np.round(other['bounds'], 4).tolist()}")
    return found


def main() -> None:
    """Compare, and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path)
    logging.disable(logging.CRITICAL)
    counts: collections.Counter[str] = collections.Counter()
    for folder in parser.parse_args().folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() not in {".obj", ".ply", ".stl"} or not path.is_file():
                continue
            mine: Facts | str
            other: Facts | str
            try:
                mine = ours(path)
            except MeshdeformError as error:
                mine = str(error)
            try:
                other = theirs(path)
            except Exception as error:  # its parsers raise exceptions of any type
                other = f"{type(error).__name__}: {error}"
            if isinstance(mine, str) or isinstance(other, str):
                both = isinstance(mine, str) and isinstance(other, str)
                kind = "refused by both" if both else "read by one"
                lines = [
                    f"{who}: {each[:200]}" for who, each in (("we", mine), ("trimesh", other)) if isinstance(each, str)
                ]
            else:
                lines = differences(mine, other)
                kind = "different" if lines else "equal"
            counts[f"{path.suffix.lower()} {kind}"] += 1
            for line in lines:
                print(f"{path.relative_to(folder)}: {line}")
    for name, count in sorted(counts.items()):
        print(f"{count:5}  {name}")


if __name__ == "__main__":
    main()
