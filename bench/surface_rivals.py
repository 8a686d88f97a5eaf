"""Other ways to send a surface, for `bench/surface_pareto.py`: each gives bytes, and how to make a mesh of them.

Decimated meshes as GLB, compressed by Draco and by meshopt, and marching tetrahedra on a grid.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import DracoPy
import numba
import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.meshopt import decode_attributes, decode_triangles
from meshdeform.assets.surface_files import DistanceGrid, OrientedPoints
from meshdeform.kinds.surface_fit.base_mesh import base_of
from meshdeform.kinds.surface_fit.cleaning import CleanMesh, clean
from meshdeform.kinds.surface_fit.isosurface import isosurface
from meshdeform.kinds.surface_fit.oriented_points import poisson_grid
from meshdeform.kinds.surface_fit.surface_sources import Surface

__all__ = ["Rival", "rivals"]

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
Mesh = tuple[_Floats, _Index]

FACES = (1000, 2000, 4000, 8000, 16_000)
CELLS = (16, 24, 32, 48, 64)
DRACO_BITS = (9, 10, 11, 12)
MESHOPT_BITS = (10, 14)


@dataclass(frozen=True)
class Rival:
    """A way to send a surface: what it costs, and what the receiver does."""

    method: str
    setting: str
    size: int
    unpack: Callable[[], Mesh]


def rivals(source: Any, surface: Surface, methods: Collection[str]) -> Iterator[Rival]:
    """Return the ways of some methods for a surface; `source` is what the file holds, `surface` its projection."""
    yield from (each for each in _all(source, surface, methods) if each.method in methods)


def _all(source: Any, surface: Surface, methods: Collection[str]) -> Iterator[Rival]:
    reference = surface.reference
    for count in FACES[: sum(c < len(reference.faces) for c in FACES) + 1]:  # the last one is the input itself
        verts, faces = base_of(reference, count)
        name = f"{len(faces)} faces"
        glb = build_glb(verts, faces)
        yield Rival("decimated", name, len(glb), partial(_from_glb, glb))
        for bits in DRACO_BITS:
            packed = draco_mesh(verts, faces, bits)
            yield Rival("Draco", f"{name}, {bits} bits", len(packed), partial(_from_draco, packed))
        for bits in MESHOPT_BITS:
            rows, order, kept = meshopt_mesh(verts, faces, bits)
            box = verts.min(0), float(np.ptp(verts, axis=0).max())
            yield Rival(
                "meshopt",
                f"{name}, {bits} bits",
                len(rows) + len(order) + 32,  # and where the box lies, and how large it is
                partial(_from_meshopt, rows, kept, box, order, len(faces), bits),
            )
    for cells in CELLS if "marching cubes" in methods else ():
        found = _grid(source, surface, cells)
        if found is None:
            return
        values, origin, spacing = found
        verts, faces = isosurface(values, origin, spacing)
        if len(faces) < 20:
            continue
        glb = build_glb(verts, faces)
        yield Rival(
            "marching cubes",
            f"{cells} cells",
            len(glb),
            partial(isosurface, values, origin, spacing),
        )


def _from_glb(data: bytes) -> Mesh:
    surface = load_asset(data, "mesh.glb").surface
    return surface.positions, surface.triangles


def _from_draco(data: bytes) -> Mesh:
    found = DracoPy.decode(data)
    return np.asarray(found.points, np.float64), np.asarray(found.faces, np.int64).reshape(-1, 3)


def _from_meshopt(packed: bytes, count: int, box: tuple[_Floats, float], order: bytes, faces: int, bits: int) -> Mesh:
    low, size = box
    found = decode_attributes(packed, count, 8).reshape(count, 8).view(np.uint16)
    index = decode_triangles(order, 3 * faces)
    return low + found[:, :3] / (2**bits - 1) * size, np.asarray(index).reshape(-1, 3).astype(np.int64)


def _grid(source: Any, surface: Surface, cells: int) -> tuple[_Floats, _Floats, _Floats] | None:
    """Return signed values on a grid with some cells along its longest side, its origin and spacing."""
    if isinstance(source, DistanceGrid):
        size = source.spacing * (np.array(source.values.shape) - 1)
        count = np.maximum(np.round(size / size.max() * cells), 1).astype(int)
        places = [np.linspace(0, n - 1, c + 1) for n, c in zip(source.values.shape, count, strict=True)]
        return _trilinear(source.values, places), source.origin, size / count
    if isinstance(source, OrientedPoints):
        values, origin, step = poisson_grid(source.points, source.normals, cells)
        return values, origin, np.full(3, step)
    assert isinstance(source, CleanMesh)
    if source.topology.border_edges:
        return None
    low, high = source.verts.min(0), source.verts.max(0)
    step = float((high - low).max()) / (cells - 3)
    shape = np.ceil((high - low) / step).astype(int) + 4
    # Off the vertices, so that no line of the grid meets an edge.
    origin = (low + high) / 2 - step * (shape - 1) / 2 + step * np.array([1e-4, 2e-4, 3e-4])
    points = origin + step * np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), -1).reshape(-1, 3)
    inside = _inside(source.verts, source.faces, origin, step, shape)
    place, _ = surface.project(points, np.zeros_like(points))
    far = np.linalg.norm(points - place, axis=1).reshape(shape)
    return np.where(inside, -far, far), origin, np.full(3, step)


def _trilinear(values: _Floats, places: list[_Floats]) -> _Floats:
    for axis, at in enumerate(places):
        low = np.minimum(at.astype(int), values.shape[axis] - 2)
        share = (at - low).reshape([-1 if k == axis else 1 for k in range(3)])
        values = values.take(low, axis) * (1 - share) + values.take(low + 1, axis) * share
    return values


@numba.njit  # type: ignore[untyped-decorator]
def _inside(verts: _Floats, faces: _Index, origin: _Floats, step: float, shape: NDArray[Any]) -> NDArray[np.bool_]:
    """Return where a line along z has crossed a closed surface an odd number of times."""
    crossed = np.zeros((shape[0], shape[1], shape[2]), np.bool_)
    for face in faces:
        a, b, c = (verts[face[0]] - origin) / step, (verts[face[1]] - origin) / step, (verts[face[2]] - origin) / step
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if area == 0:
            continue
        for i in range(int(np.ceil(min(a[0], b[0], c[0]))), int(np.floor(max(a[0], b[0], c[0]))) + 1):
            for j in range(int(np.ceil(min(a[1], b[1], c[1]))), int(np.floor(max(a[1], b[1], c[1]))) + 1):
                u = ((b[0] - i) * (c[1] - j) - (c[0] - i) * (b[1] - j)) / area
                v = ((c[0] - i) * (a[1] - j) - (a[0] - i) * (c[1] - j)) / area
                if u < 0 or v < 0 or u + v > 1:
                    continue
                z = u * a[2] + v * b[2] + (1 - u - v) * c[2]
                for k in range(int(np.ceil(z)), shape[2]):
                    crossed[i, j, k] = not crossed[i, j, k]
    return crossed


def read_source(data: bytes, name: str) -> Any:
    """Return what a file describes, as `surface_of` wants it."""
    from meshdeform.assets.limits import Limits
    from meshdeform.assets.surface_files import read_surface_file

    found = read_surface_file(data, name, Limits())
    if found is not None:
        return found
    surface = load_asset(data, name).surface
    return clean(surface.positions, surface.triangles)


def draco_mesh(verts: _Floats, faces: _Index, bits: int) -> bytes:
    """Return vertices (V, 3) and faces (F, 3) compressed by Draco, as small as it can."""
    return bytes(DracoPy.encode(verts, faces.astype(np.uint32), quantization_bits=bits, compression_level=10))


def meshopt_mesh(verts: _Floats, faces: _Index, bits: int) -> tuple[bytes, bytes, int]:
    """Return vertices as integers of some bits and faces compressed by meshopt, and how many vertices there are.

    Both are in the order that compresses best. A vertex has eight bytes: x, y, z and zero.

    Raises
    ------
    ImportError
        meshoptimizer is not installed.
    """
    import meshoptimizer

    indices = np.ascontiguousarray(faces.ravel().astype(np.uint32))
    best = np.zeros_like(indices)
    meshoptimizer.optimize_vertex_cache(best, indices, len(indices), len(verts))
    low, size = verts.min(0), float(np.ptp(verts, axis=0).max())
    whole = np.zeros((len(verts), 4), np.uint16)
    whole[:, :3] = np.round((verts - low) / size * (2**bits - 1))
    _, first = np.unique(best, return_index=True)
    order = best[np.sort(first)]  # vertices in the order in which they are met
    place = np.empty(len(verts), np.uint32)
    place[order] = np.arange(len(order))
    rows = np.ascontiguousarray(whole[order])
    packed = meshoptimizer.encode_vertex_buffer(rows.view(np.uint8).reshape(len(rows), 8), len(rows), 8)
    return packed, meshoptimizer.encode_index_buffer(np.ascontiguousarray(place[best]), len(best), len(rows)), len(rows)
