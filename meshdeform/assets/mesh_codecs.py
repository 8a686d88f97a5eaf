"""Compress the positions and faces of a mesh by Draco and by meshopt, to compare their size with that of a field.

Draco comes with the extra `asset`. The encoder of meshopt is no requirement, since it has no wheels: where
meshoptimizer is not installed, there is no figure for it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_BITS = (6, 16)
_ROUNDS = 3


def as_precise(distance: float, extent: float) -> int:
    """Return the fewest bits (6 to 16) whose rounding moves a surface by at most `distance` on average.

    Rounding to a grid of cells of size c moves points along a normal by c / 4 on average, c being `extent` / 2^bits.
    """
    wanted = math.log2(extent / (4 * distance)) if distance > 0 else _BITS[1]
    return min(max(math.ceil(wanted), _BITS[0]), _BITS[1])


def draco_mesh(verts: _Floats, faces: _Index, bits: int) -> bytes:
    """Return vertices (V, 3) and faces (F, 3) compressed by Draco, as small as it can."""
    import DracoPy

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


def packed_sizes(verts: _Floats, faces: _Index, bits: int) -> dict[str, Any]:
    """Return the bytes of a mesh compressed by Draco and meshopt, and the CPU milliseconds of unpacking.

    Both decoders are the native ones of their libraries; of three rounds the fastest counts. None stands for what is
    not installed.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
    """
    import DracoPy

    draco = draco_mesh(verts, faces, bits)
    found: dict[str, Any] = {
        "faces": len(faces),
        "bits": bits,
        "draco": {"bytes": len(draco), "unpack_ms": _fastest(lambda: DracoPy.decode(draco))},
        "meshopt": None,
    }
    try:
        import meshoptimizer

        rows, indices, count = meshopt_mesh(verts, faces, bits)
    except ImportError:
        return found

    def unpack() -> None:
        meshoptimizer.decode_vertex_buffer(count, 8, rows)
        meshoptimizer.decode_index_buffer(faces.size, 4, indices)

    # And where the box lies and how large it is: four float64.
    found["meshopt"] = {"bytes": len(rows) + len(indices) + 32, "unpack_ms": _fastest(unpack)}
    return found


def _fastest(work: Callable[[], Any]) -> float:
    times = []
    for _ in range(_ROUNDS):
        begin = time.process_time()
        work()
        times.append(1000 * (time.process_time() - begin))
    return round(min(times), 3)
