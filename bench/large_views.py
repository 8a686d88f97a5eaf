"""Compare ways to show a large result on the page: bytes, CPU seconds for the worker to make it, and how far off it is.

python -m bench.large_views

The result is a bumpy torus of 200,000 triangles, twisted. Rivals of its GLB: its positions and normals alone, as the
page fetches them by byte ranges; the whole mesh by Draco with 14 bits, as small as it can and with the vertices in
their order, which the page's colours and its morph need; a decimated mesh of 20,000 triangles, as a GLB of whole
numbers of 16 bits and by Draco; and a field (base of 500 faces, level 3, as many steps as asked for). Distances are
means of both ways, as shares of the diagonal.
"""

from __future__ import annotations

import argparse
import gzip
import json
import time
from collections.abc import Callable
from typing import Any

import DracoPy
import numpy as np
import torch
from numpy.typing import NDArray

from bench.make_surfaces import bumpy_torus
from bench.surface_pareto import fit
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.simplify import simplified
from meshdeform.kinds.surface_fit.cleaning import clean
from meshdeform.kinds.surface_fit.level_files import level_glb
from meshdeform.kinds.surface_fit.measures import distances
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.surface_sources import surface_of

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
Made = tuple[int, _Floats, _Index]
FEWER, LEVEL, BITS = 20_000, 3, 14


def twisted() -> tuple[_Floats, _Index]:
    """Return a torus of 200,000 triangles, turned about Y the more the higher, with vertices off by a fifth of an edge.

    They are off along the surface: in rows and columns they would be easier to compress than those of any real mesh.
    """
    verts, faces = bumpy_torus(500, 200)
    turn = 2 * verts[:, 1]
    x, z = (
        verts[:, 0] * np.cos(turn) - verts[:, 2] * np.sin(turn),
        verts[:, 0] * np.sin(turn) + verts[:, 2] * np.cos(turn),
    )
    verts = np.stack([x, verts[:, 1], z], 1)
    a, b, c = (verts[faces[:, k]] for k in range(3))
    normals = np.zeros_like(verts)
    for k in range(3):
        np.add.at(normals, faces[:, k], np.cross(b - a, c - a))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shift = 0.2 * np.median(np.linalg.norm(b - a, axis=1)) * np.random.default_rng(0).normal(size=verts.shape)
    return verts + shift - (shift * normals).sum(1, keepdims=True) * normals, faces


def ways(verts: _Floats, faces: _Index, steps: int) -> dict[str, Callable[[], Made]]:
    """Return what makes each view: its bytes, vertices and faces."""

    def fewer() -> TriangleMesh:
        return simplified(TriangleMesh(torch.from_numpy(verts), torch.from_numpy(faces)), FEWER)

    def rounded() -> Made:
        mesh = fewer()
        points, corners = mesh.verts.numpy(), mesh.faces.numpy()
        low, size = points.min(0), np.ptp(points, axis=0).max()
        whole = np.round((points - low) / size * 65_535)
        return 8 * len(points) + 2 * corners.size, low + whole / 65_535 * size, corners

    def packed() -> Made:
        mesh = fewer()
        return draco(mesh.verts.numpy(), mesh.faces.numpy(), keep=False)

    def draco(points: _Floats, corners: _Index, *, keep: bool) -> Made:
        data = DracoPy.encode(
            points, corners.astype(np.uint32), quantization_bits=BITS, compression_level=10, preserve_order=keep
        )
        found = DracoPy.decode(data)
        return len(data), np.asarray(found.points, np.float64), np.asarray(found.faces, np.int64)

    def field() -> Made:
        data = fit(surface_of(clean(verts, faces)), 500, 32, steps)
        return len(data), *read_field(data).unfold(LEVEL)

    return {
        "GLB": lambda: (len(level_glb(verts, faces)), verts, faces),
        "GLB, gzip": lambda: (len(gzip.compress(level_glb(verts, faces), 6)), verts, faces),
        "positions and normals of the GLB": lambda: (24 * len(verts), verts, faces),
        "Draco, vertices in their order": lambda: draco(verts, faces, keep=True),
        "Draco": lambda: draco(verts, faces, keep=False),
        "20,000 triangles, 16 bits": rounded,
        "20,000 triangles, Draco": packed,
        "field": field,
    }


def main() -> None:
    """Measure each way and print a line of JSON for it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=400)
    given = parser.parse_args()
    torch.set_num_threads(1)
    verts, faces = twisted()
    surface = surface_of(clean(verts, faces))
    ways(*bumpy_torus(40, 20), 2)["field"]()  # compiles
    for name, make in ways(verts, faces, given.steps).items():
        begin = time.process_time()
        size, points, corners = make()
        row: dict[str, Any] = {"way": name, "bytes": size, "cpu_s": round(time.process_time() - begin, 3)}
        own = points is verts
        row |= {"triangles": len(corners), "distance": 0.0 if own else distances(surface, points, corners)["mean"]}
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
